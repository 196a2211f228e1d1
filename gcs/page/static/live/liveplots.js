// Signals over the last minute, drawn as they come.

import { h } from '../shared/dom.js'
import { shownUnit, signalName } from '../shared/format.js'
import { bokeh, legendAbove, line, plot, removePlot, shown, source } from '../shared/plots.js'
import { keepQuery } from '../shared/router.js'
import { Sight } from './sight.js'

const WINDOW_S = 60
const EVERY_MS = 100
// Plots rest eleven times as long as they took: a twelfth of the time is theirs, however many are in sight on whatever
// device.
const REST = 11
const LEAST_REST_MS = 200
// What stood still meanwhile, as a computer that slept, is not the plots' doing.
const MOST_REST_MS = 1500
const USUAL = [['de', 'da', 'dr'], ['p', 'q', 'r'], ['alpha', 'beta'], ['airspeed'], ['phi', 'theta']]

/** @typedef {{ range: BokehRange, sources: [string, BokehSource][], element: PlotElement }} LivePanel */

/** Plots of surfaces, rates, flow angles, airspeed and attitude, and of the signals that the user chooses. */
export class LivePlots {
  /** @param {URLSearchParams} query @param {AbortSignal} signal */
  constructor(query, signal) {
    this.query = query
    this.signal = signal
    /** @type {Map<string, { x: number[], y: number[] }>} */
    this.kept = new Map()
    /** @type {Record<string, string>} */
    this.unitOf = {}
    /** @type {LivePanel[]} */
    this.panels = []
    this.built = ''
    this.newest = 0
    this.dirty = false
    this.restsUntil = 0
    this.chosen = new Set(query.get('signals')?.split(',').filter(Boolean) ?? [])
    this.place = h('div', { class: 'plots' }, h('p', {}, 'Signals are plotted here as soon as the vehicle sends them.'))
    this.choices = h('fieldset', { class: 'choices' }, h('legend', {}, 'Further signals to plot'))
    this.elements = [h('h2', {}, 'Signals of the last minute'), this.place,
      h('details', { class: 'panel' }, h('summary', {}, 'Choose signals'), this.choices)]
    this.sight = new Sight(signal)
    const timer = setInterval(() => this.draw(), EVERY_MS)
    signal.addEventListener('abort', () => clearInterval(timer))
  }

  /** Units by signal, as GET /api/live gives them. @param {Record<string, LiveSignal>} signals */
  units(signals) {
    for (const [name, entry] of Object.entries(signals)) this.unitOf[name] = entry.unit
  }

  /** Whether the units of all these signals are known. @param {Record<string, number | null>} signals */
  knows(signals) {
    return Object.keys(signals).every(name => name in this.unitOf)
  }

  /**
   * Take an event of signals: the newest value of each, and all samples since the event before where they come.
   * @param {SignalsEvent} event
   */
  add({ time_s: time, signals, samples = {} }) {
    if (time === null) return
    if (time < this.newest) this.clear()
    this.newest = time
    let fresh = false
    for (const [name, value] of Object.entries(signals)) {
      const { x, y } = this.kept.get(name) ?? { x: [], y: [] }
      if (!this.kept.has(name)) {
        fresh = true
        this.kept.set(name, { x, y })
      }
      const factor = this.shownUnit(name)[1]
      const [times, values] = samples[name] ?? [[time], [value]]
      for (const [index, at] of times.entries()) {
        if (at <= (x.at(-1) ?? -Infinity)) continue
        x.push(at)
        y.push(values[index] === null ? NaN : values[index] * factor)
      }
      const old = x.findIndex(at => at >= time - WINDOW_S)
      if (old > 0) {
        x.splice(0, old)
        y.splice(0, old)
      }
    }
    if (fresh) this.build()
    this.dirty = true
  }

  /**
   * Take GET /api/live/minute: what was before the page was opened, or while its connection was lost.
   * @param {Minute} minute
   */
  fill({ time_s: times, signals }) {
    const end = times.at(-1)
    if (end === undefined || end < this.newest - WINDOW_S) return
    for (const [name, values] of Object.entries(signals)) {
      if (!(name in this.unitOf)) continue
      const factor = this.shownUnit(name)[1]
      const later = this.kept.get(name) ?? { x: [], y: [] }
      const from = later.x.findIndex(at => at > end)
      const tail = from < 0 ? later.x.length : from
      this.kept.set(name, {
        x: [...times, ...later.x.slice(tail)],
        y: [...values.map(value => value === null ? NaN : value * factor), ...later.y.slice(tail)],
      })
    }
    this.newest = Math.max(this.newest, end)
    this.build()
    this.dirty = true
  }

  clear() {
    for (const entry of this.kept.values()) Object.assign(entry, { x: [], y: [] })
    this.newest = 0
  }

  /** @param {string} name */
  shownUnit(name) {
    return shownUnit(this.unitOf[name])
  }

  /** The panels that the signals at hand make. */
  build() {
    this.offer()
    const groups = USUAL.map(group => group.map(name => name === 'airspeed' && !this.kept.has(name) ? 'V' : name))
      .concat([...this.chosen].map(name => [name])).map(group => group.filter(name => this.kept.has(name)))
      .filter(group => group.length)
    const key = JSON.stringify(groups)
    if (key === this.built) return
    this.built = key
    this.make(groups)
  }

  /** @param {string[][]} groups */
  async make(groups) {
    const built = this.built
    const Bokeh = await bokeh()
    /** @type {LivePanel[]} */
    const made = []
    for (const names of groups) {
      const range = new Bokeh.Range1d({ start: 0, end: WINDOW_S })
      const [unit] = this.shownUnit(names[0])
      const title = names.map(signalName).join(' and ')
      const figure = await plot({ x: 'time, s',
        y: names.length > 1 ? unit : `${signalName(names[0])}${unit ? `, ${unit}` : ''}`, xRange: range, height: 200 })
      /** @type {LivePanel['sources']} */
      const sources = []
      for (const [index, name] of names.entries()) {
        sources.push([name, await source({ x: [], y: [] })])
        line(figure, sources[index][1], 'x', 'y', index, names.length > 1 ? signalName(name) : null)
      }
      if (names.length > 1) legendAbove(figure)
      made.push({ range, sources, element: await shown(figure, `${title} over the last minute`, this.signal) })
    }
    if (built !== this.built || this.signal.aborted) {
      for (const { element } of made) removePlot(element)
      return
    }
    for (const { element } of this.panels) {
      this.sight.forget(element)
      removePlot(element)
    }
    this.panels = made
    // What came while they were made is drawn when they are seen first.
    for (const { element } of made) this.sight.watch(element, () => { this.dirty = true })
    this.place.replaceChildren(...made.map(panel => panel.element))
  }

  draw() {
    const begun = performance.now()
    if (!this.dirty || document.hidden || begun < this.restsUntil) return
    this.dirty = false
    // The library paints in the next frame, behind this call; the browser is done with it when the timer comes.
    requestAnimationFrame(() => {
      const frame = performance.now()
      setTimeout(() => {
        const end = performance.now()
        const rest = REST * (prepared - begun + end - frame)
        this.restsUntil = end + Math.min(Math.max(rest, LEAST_REST_MS), MOST_REST_MS)
      })
    })
    for (const { range, sources, element } of this.panels) {
      if (!this.sight.has(element)) continue
      range.setv({ start: Math.max(0, this.newest - WINDOW_S), end: Math.max(this.newest, WINDOW_S) })
      for (const [name, data] of sources) {
        const { x, y } = this.kept.get(name) ?? { x: [], y: [] }
        data.data = { x: x.slice(), y: y.slice() }
      }
    }
    const prepared = performance.now()
  }

  offer() {
    const boxes = [...this.kept.keys()].filter(name => !USUAL.flat().includes(name)).sort().map(name =>
      h('label', { class: 'choice' },
        h('input', { type: 'checkbox', checked: this.chosen.has(name), change: event => {
          this.chosen[event.target.checked ? 'add' : 'delete'](name)
          this.query.set('signals', [...this.chosen].join(','))
          keepQuery(this.query)
          this.build()
        } }), signalName(name)))
    this.choices.replaceChildren(/** @type {Node} */ (this.choices.firstChild), ...boxes)
  }
}
