// Coefficients as they are estimated in flight: a table of all, and the bands of the main ones converging.

import { h, remark } from '../shared/dom.js'
import { NONE, number, percent, plusMinus, shownUnit } from '../shared/format.js'
import { LiveTable, write } from './livetable.js'
import { band, bokeh, line, plot, shown, source } from '../shared/plots.js'
import { Sight } from './sight.js'

const MAIN = ['CL_alpha', 'Cm_alpha', 'Cm_de', 'Cl_p', 'Cl_da', 'Cn_beta']
const KEPT = 1200

/** @typedef {{ element: HTMLElement, data?: BokehSource, follow?: (band: LiveBand) => void }} BandPanel */

/** The live estimates. */
export class Identification {
  /** @param {AbortSignal} signal */
  constructor(signal) {
    this.signal = signal
    /** @type {Map<string, LiveBand>} */
    this.history = new Map()
    /** @type {Map<string, BandPanel>} */
    this.panels = new Map()
    this.sight = new Sight(signal)
    this.count = h('p', {}, 'Nothing is estimated yet.')
    this.speed = h('p', { class: 'hint' })
    this.missing = h('p', {})
    this.why = remark('note', this.missing)
    this.why.hidden = true
    this.plots = h('div', { class: 'small plots' })
    this.coefficients = new LiveTable('Coefficients of the last 25 s',
      ['Coefficient', 'Value ± 1 σ', 'Not known yet', 'Fly next'], ['', '', 'Not known yet', 'Fly next'])
    this.sensors = new LiveTable('Wind, sensors and servos in flight', ['Name', 'Value ± 1 σ', 'Unit'], [])
    this.elements = [h('h2', {}, 'Coefficients'), this.why, this.count, this.speed, this.plots,
      this.coefficients.element, this.sensors.element]
  }

  /** Another flight: its plots are those of the last one, out of sight until they have something to show. */
  clear() {
    this.history.clear()
    for (const { element } of this.panels.values()) element.hidden = true
  }

  /**
   * Take an object of identification, null (with why) where there is none; time: s of the flight, landed: behind one.
   * @param {LiveEstimate | null} found
   * @param {string | null | undefined} why
   * @param {number | null} time
   */
  show(found, why, time, landed = false) {
    this.why.hidden = Boolean(found)
    const entries = Object.entries(found?.coefficients ?? {})
    const known = entries.filter(([, entry]) => entry.known).length
    // What is estimated on the ground, behind a flight, is nobody's result.
    write(this.count, found && (known || !landed) ? `${known} of ${entries.length} coefficients known.` : '')
    write(this.speed, found ? speed(found) : '', 'hint')
    this.coefficients.show(found ? coefficients(found) : [])
    this.sensors.show(found ? sensors(found) : [])
    if (!found) {
      write(this.missing, why ?? 'Start the service with --vehicle FILE to identify in flight.')
      return
    }
    for (const name of MAIN.filter(one => Number.isFinite(found.coefficients[one]?.value))) this.keep(name,
      found.coefficients[name], time)
  }

  /** @param {string} name @param {Estimate} entry @param {number | null} time */
  keep(name, { value, std }, time) {
    if (time === null || !Number.isFinite(std)) return
    const kept = this.history.get(name) ?? { x: [], y: [], low: [], high: [] }
    this.history.set(name, kept)
    if ((kept.x.at(-1) ?? -Infinity) >= time) return
    kept.x.push(time)
    kept.y.push(value)
    kept.low.push(value - 1.96 * std)
    kept.high.push(value + 1.96 * std)
    if (kept.x.length > KEPT) Object.values(kept).forEach(column => column.splice(0, column.length - KEPT))
    this.draw(name, kept)
  }

  /**
   * The plot before which that of a coefficient stands; the order is theirs, not that in which they become known.
   * @param {string} name
   */
  later(name) {
    const behind = MAIN.slice(MAIN.indexOf(name) + 1).map(one => this.panels.get(one)?.element)
    return behind.find(element => element?.parentElement === this.plots) ?? null
  }

  /** @param {string} name @param {LiveBand} kept */
  draw(name, kept) {
    const panel = this.panels.get(name) ?? this.make(name)
    panel.element.hidden = false
    if (!this.sight.has(panel.element)) return
    panel.follow?.(kept)
    const columns = Object.fromEntries(Object.entries(kept).map(([key, column]) => [key, column.slice()]))
    if (panel.data) panel.data.data = columns
  }

  /** The plot of a coefficient, which fills as soon as the library is there. @param {string} name */
  make(name) {
    /** @type {BandPanel} */
    const panel = { element: h('div', {}) }
    this.panels.set(name, panel)
    this.drawn(name).then(made => {
      made.element.hidden = panel.element.hidden
      Object.assign(panel, made)
      this.plots.insertBefore(panel.element, this.later(name))
      this.sight.watch(panel.element, () => {
        const kept = this.history.get(name)
        if (kept) this.draw(name, kept)
      })
    }).catch(() => this.panels.delete(name))
    return panel
  }

  /** @param {string} name */
  async drawn(name) {
    const data = await source({ x: [], y: [], low: [], high: [] })
    const { range, follow } = await following()
    const figure = await plot({ x: 'time, s', y: name, height: 170, yRange: range })
    band(figure, data, 'x', 'low', 'high')
    line(figure, data, 'x', 'y', 0)
    return { element: await shown(figure, `${name} with its 95 % band`, this.signal), data, follow }
  }
}

/** A range of heights about the last three quarters: the wide first bands would flatten the rest. */
async function following() {
  const Bokeh = await bokeh()
  const range = new Bokeh.Range1d({ start: 0, end: 1 })
  /** @param {LiveBand} band */
  const follow = ({ low, high }) => {
    const first = Math.floor(low.length / 4)
    const [start, end] = [Math.min(...low.slice(first)), Math.max(...high.slice(first))]
    const margin = 0.1 * (end - start || 1)
    range.setv({ start: start - margin, end: end + margin })
  }
  return { range, follow }
}

/** @param {LiveEstimate} found */
function speed(found) {
  const { median, p95 } = found.latency_ms ?? {}
  if (!Number.isFinite(median)) return ''
  const busy = found.cpu_share ?? NaN
  const share = Number.isFinite(busy) ? `, ${percent(busy)} of one core` : ''
  return `Coefficients are those of the last 25 s. Every message is watched for changes after ${number(median, 2)} ms `
    + `(median; 95 % below `
    + `${number(p95, 2)}), ${number(found.updates_per_s, 2)} times a second${share}.`
}

/** The estimate; a first idea of one that is not known yet stands in brackets. @param {LiveCoefficient} entry */
function value(entry) {
  if (!Number.isFinite(entry.value)) return NONE
  return entry.known ? plusMinus(entry) : `(${plusMinus(entry)})`
}

/**
 * Rows of the table; a reason that stands just above is not said again.
 * @param {LiveEstimate} found
 * @returns {LiveRow[]}
 */
function coefficients(found) {
  let last = ''
  return Object.entries(found.coefficients).map(([name, entry]) => {
    const why = entry.known ? '' : entry.why ?? ''
    const said = why && why === last ? 'as above' : why
    last = why
    return [name, value(entry), said, entry.known ? '' : entry.fly ?? '']
  })
}

/**
 * Wind and errors of sensors, then what else was estimated of what stands between the aircraft and its messages.
 * @param {LiveEstimate} found
 */
function sensors(found) {
  const between = (found.nuisances ?? []).filter(one => one.estimated && !(one.name in (found.sensors ?? {})))
  /** @type {LiveRow[]} */
  const own = Object.entries(found.sensors ?? {}).map(([name, entry]) => {
    const [unit, factor] = shownUnit(entry.unit)
    return [name, plusMinus({ value: entry.value * factor, std: entry.std * factor }), unit]
  })
  /** @type {LiveRow[]} */
  const others = between.map(({ text, shown }) => [text, plusMinus(shown), shownUnit(shown.unit)[0]])
  return [...own, ...others]
}
