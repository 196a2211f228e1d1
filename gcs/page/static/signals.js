// Signals of a flight over time. What is drawn is thinned by the service, which keeps the extremes; zooming asks anew.

import { get } from './api.js'
import { announce } from './announce.js'
import { h, remark } from './dom.js'
import { number, shownUnit, signalName } from './format.js'
import { bokeh, gaps, line, plot, shown, source } from './plots.js'
import { keepQuery } from './router.js'

const USUAL = ['airspeed', 'alpha', 'beta', 'q', 'de']
const POINTS = 1000
const PATIENCE_MS = 150

/** The section of signals of a flight. The address keeps which of them, and the stretch. */
export async function signals(page, summary, query, signal) {
  page.append(h('h2', {}, 'Signals'))
  if (!summary.signals.length) {
    page.append(remark('note', h('p', {}, summary.state === 'recording'
      ? 'The flight is still being recorded; its signals stand here when it is over. Until then see the live page.'
      : 'No signal can be read from this recording; the warnings above say why.')))
    return
  }
  const chosen = new Set((query.get('signals')?.split(',') ?? USUAL).filter(name => summary.signals.includes(name)))
  if (!chosen.size) chosen.add(summary.signals[0])
  const place = h('div', { class: 'plots' })
  const drawing = new Drawing(summary, place, query, signal)
  const boxes = summary.signals.map(name => h('label', { class: 'choice' }, h('input', {
    type: 'checkbox', checked: chosen.has(name), change: event => {
      chosen[event.target.checked ? 'add' : 'delete'](name)
      query.set('signals', [...chosen].join(','))
      keepQuery(query)
      drawing.draw([...chosen])
    },
  }), signalName(name)))
  page.append(
    h('details', { class: 'panel' }, h('summary', {}, 'Choose signals'),
      h('fieldset', { class: 'choices' }, h('legend', {}, 'Signals to plot'), boxes)),
    drawing.controls(), place)
  await drawing.draw([...chosen])
}

/** The plots below each other, over one range of time. */
class Drawing {
  constructor(summary, place, query, signal) {
    Object.assign(this, { summary, place, query, signal, sources: new Map(), serial: 0 })
    this.whole = [0, Infinity]
    this.span = h('output', { class: 'span' })
  }

  async draw(names) {
    const serial = ++this.serial
    const Bokeh = await bokeh()
    this.stop?.abort()
    this.stop = new AbortController()
    this.signal.addEventListener('abort', () => this.stop.abort())
    this.names = names
    const { query } = this
    this.range = query.has('end') ? { start: Number(query.get('start')), end: Number(query.get('end')) } : null
    const found = names.length ? await this.fetch() : {}
    if (serial !== this.serial) return
    this.range ??= this.learn(found)
    this.sources = new Map()
    const made = []
    for (const name of names) made.push(await this.one(name, found[name], new Bokeh.Range1d(this.range)))
    this.place.replaceChildren(...made)
    this.showSpan()
  }

  async one(name, series, range) {
    const [unit, factor] = shownUnit(series.unit)
    const data = await source(columns(series, factor))
    const figure = await plot({ x: 'time, s', y: unit, xRange: range, height: 200, select: true })
    line(figure, data, 'x', 'y', 0)
    const element = await shown(figure, caption(name, series), this.stop.signal)
    element.prepend(h('h3', {}, `${signalName(name)}${unit ? `, ${unit}` : ''}`))
    this.sources.set(name, { data, factor, element, range })
    range.change.connect(() => this.moved(range))
    return element
  }

  /** The flight from its first to its last sample; a vehicle's clock may run at another pace than ours. */
  learn(found) {
    const ends = Object.values(found).filter(series => series.time.length).flatMap(({ time }) => [time[0], time.at(-1)])
    if (ends.length) this.whole = [Math.min(...ends), Math.max(...ends)]
    return { start: this.whole[0], end: this.whole[1] }
  }

  fetch() {
    const query = new URLSearchParams({ names: this.names.join(','), points: POINTS })
    if (this.range) {
      const margin = 0.02 * (this.range.end - this.range.start)
      query.set('start', this.range.start - margin)
      query.set('end', this.range.end + margin)
    }
    return get(`/api/flights/${encodeURIComponent(this.summary.id)}/signals?${query}`, this.signal)
      .then(answer => answer.signals)
  }

  /** Back to all of the flight. */
  all() {
    this.query.delete('start')
    this.query.delete('end')
    this.range = null
    return this.draw(this.names).then(() => keepQuery(this.query))
  }

  /** All plots follow the one whose range has changed. */
  moved({ start, end }) {
    if (start === this.range.start && end === this.range.end) return
    this.range = { start, end }
    for (const { range } of this.sources.values()) range.setv(this.range)
    this.showSpan()
    clearTimeout(this.timer)
    this.timer = setTimeout(() => this.refresh(), PATIENCE_MS)
  }

  async refresh() {
    const serial = ++this.serial
    try {
      const found = await this.fetch()
      if (serial !== this.serial) return
      for (const [name, { data, factor, element }] of this.sources) {
        data.data = columns(found[name], factor)
        element.say(caption(name, found[name]))
      }
      this.query.set('start', this.range.start.toFixed(3))
      this.query.set('end', this.range.end.toFixed(3))
      keepQuery(this.query)
    } catch (error) {
      if (error.name !== 'AbortError') announce(error.message, true)
    }
  }

  showSpan() {
    this.span.textContent = `${number(this.range.start, 4)} to ${number(this.range.end, 4)} s`
  }

  /** Show the stretch from start to end, s, kept within the flight. */
  look(start, end) {
    const [begin, finish] = this.whole
    const length = Math.min(end - start, finish - begin)
    const first = Math.min(Math.max(start, begin), finish - length)
    this.moved({ start: first, end: first + length })
    announce(`Shown: ${this.span.textContent}`)
  }

  controls() {
    const zoom = factor => () => {
      const { start, end } = this.range
      const [middle, half] = [(start + end) / 2, factor * (end - start) / 2]
      this.look(middle - half, middle + half)
    }
    const move = share => () => {
      const { start, end } = this.range
      this.look(start + share * (end - start), end + share * (end - start))
    }
    const button = (text, label, click) => h('button', { type: 'button', 'aria-label': label, click }, text)
    return h('div', { class: 'row', role: 'group', 'aria-label': 'Stretch of time' },
      button('+', 'Zoom in', zoom(0.5)), button('−', 'Zoom out', zoom(2)),
      button('◀', 'Earlier', move(-0.5)), button('▶', 'Later', move(0.5)),
      button('Whole flight', 'Whole flight', () => this.all()), this.span)
  }
}

const columns = (series, factor) => gaps({ x: series.time, y: series.value.map(v => v === null ? null : v * factor) })

/** What a signal does in the stretch, in words. */
export function caption(name, series) {
  const [unit, factor] = shownUnit(series.unit)
  const values = series.value.filter(value => value !== null).map(value => value * factor)
  if (!values.length) return `${signalName(name)}: no value in this stretch`
  const [low, high] = values.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity])
  return `${signalName(name)} lies between ${number(low)} and ${number(high)} ${unit}, from ${series.source}`
}
