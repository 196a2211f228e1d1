// Signals of a flight: which, how they are drawn, and of which stretch; the address keeps all three.

import { get, hand, post } from './api.js'
import { announce } from './announce.js'
import { Cursor } from './cursor.js'
import { field, h, remark, select, table } from './dom.js'
import { number, shownUnit, signalName } from './format.js'
import { againstEachOther, overTime, spectra } from './signalplots.js'
import { bokeh } from './plots.js'
import { keepQuery } from './router.js'

const USUAL = ['airspeed', 'alpha', 'beta', 'q', 'de']
const POINTS = 1000
const FINE = 20_000
const PATIENCE_MS = 150
const SEVERITIES = ['emergency', 'alert', 'critical', 'error', 'warning', 'notice', 'info', 'debug']
const WAYS = [['', 'each in a plot of its own'], ['together', 'those of one unit together'],
  ['xy', 'against the first one'], ['spectrum', 'as spectra']]

/** The section of signals of a flight. begun: called with a job that was started for the stretch that is shown. */
export async function signals(page, summary, query, signal, begun) {
  page.append(h('h2', {}, 'Signals'))
  if (!summary.signals.length) {
    page.append(remark('note', h('p', {}, summary.state === 'recording'
      ? 'The flight is still being recorded; its signals stand here when it is over. Until then see the live page.'
      : 'No signal can be read from this recording; the warnings above say why.')))
    return
  }
  const fields = new Set(Object.entries(summary.fields).flatMap(([message, names]) => names.map(name => `${message}.${name}`)))
  const chosen = new Set((query.get('signals')?.split(',') ?? USUAL).filter(name => summary.signals.includes(name) || fields.has(name)))
  if (!chosen.size) chosen.add(summary.signals[0])
  const drawing = new Drawing(summary, query, signal, begun)
  const again = () => drawing.draw([...chosen]).catch(error => {
    if (!signal.aborted) announce(error.message, true)
  })
  const box = name => h('label', { class: 'choice' }, h('input', {
    type: 'checkbox', checked: chosen.has(name), change: event => {
      chosen[event.target.checked ? 'add' : 'delete'](name)
      query.set('signals', [...chosen].join(','))
      keepQuery(query)
      again()
    },
  }), signalName(name))
  const way = select(WAYS, query.get('as') ?? '', value => {
    query.set('as', value)
    keepQuery(query)
    again()
  })
  way.setAttribute('aria-label', 'How they are drawn')
  page.append(
    h('details', { class: 'panel' }, h('summary', {}, 'Choose signals'),
      h('fieldset', { class: 'choices' }, h('legend', {}, 'Signals to plot'), summary.signals.map(box)),
      anyField(summary.fields, chosen, box)),
    h('div', { class: 'row' }, h('label', {}, 'Drawn ', way)),
    drawing.controls(), summary.used.length ? h('p', { class: 'hint' }, 'Shaded green: the parts that the model was made from.') : '',
    drawing.cursor.element, drawing.place, events(summary, drawing))
  await again()
}

/** Any number of any message as it was sent: a message is chosen first. */
function anyField(messages, chosen, box) {
  const names = Object.keys(messages)
  if (!names.length) return ''
  const list = h('fieldset', { class: 'choices' })
  const show = message => list.replaceChildren(h('legend', {}, `Fields of ${message}, as they were sent`), ...messages[message].map(name => box(`${message}.${name}`)))
  const first = [...chosen].map(name => name.split('.')[0]).find(name => name in messages) ?? names[0]
  show(first)
  return h('div', {}, field('Any field of a message', select(names.map(name => [name, name]), first, show)), list)
}

/** Modes of the autopilot and what the vehicle said; each leads the cursor there. */
function events({ modes, texts }, drawing) {
  const rows = [
    ...modes.map(one => ({ time: one.start, what: `${one.mode}${one.armed ? '' : ', disarmed'}`, kind: 'mode' })),
    ...texts.map(one => ({ time: one.time, what: one.text, kind: SEVERITIES[one.severity] ?? 'text' })),
  ].sort((a, b) => a.time - b.time)
  if (!rows.length) return ''
  const found = table('What happened', ['Time, s', 'What', 'Kind'], rows.map(({ time, what, kind }) => [
    h('button', { type: 'button', class: 'small', 'aria-label': `Put the cursor to ${time.toFixed(1)} s`, click: () => drawing.cursor.move(time) }, time.toFixed(1)), what, kind]))
  return h('details', {}, h('summary', {}, `Modes and texts (${rows.length})`), found)
}

/** The plots below each other, over one range of time. */
class Drawing {
  constructor(summary, query, signal, begun) {
    Object.assign(this, { summary, query, signal, begun, shown: [], serial: 0, whole: [0, Infinity], names: [] })
    this.place = h('div', { class: 'plots' })
    this.cursor = new Cursor()
    this.span = h('output', { class: 'span' })
  }

  async draw(names) {
    const serial = ++this.serial
    await bokeh()
    this.stop?.abort()
    this.stop = new AbortController()
    this.signal.addEventListener('abort', () => this.stop.abort())
    this.names = names
    const { query } = this
    this.way = query.get('as') ?? ''
    this.range = query.has('end') ? { start: Number(query.get('start')), end: Number(query.get('end')) } : null
    const found = names.length ? await this.fetch() : {}
    if (serial !== this.serial) return
    this.found = found
    if (this.way !== 'spectrum') this.range ??= this.learn(found)
    else if (!this.range) this.range = await this.length()
    const { way, stop, range, summary } = this
    this.shown = way === 'spectrum' ? await spectra(names, found, stop.signal)
      : way === 'xy' ? await againstEachOther(names, found, stop.signal)
        : await overTime(names, found, range, way === 'together', summary, changed => this.moved(changed), stop.signal)
    if (serial !== this.serial) return
    this.place.replaceChildren(...this.shown.map(({ element }) => element))
    this.cursor.element.hidden = way === 'xy' || way === 'spectrum'
    this.cursor.show(this.cursor.element.hidden ? [] : this.shown)
    this.showSpan()
  }

  /** The flight from its first to its last sample; a vehicle's clock may run at another pace than ours. */
  learn(found) {
    const ends = Object.values(found).filter(series => series.time.length).flatMap(({ time }) => [time[0], time.at(-1)])
    if (ends.length) this.whole = [Math.min(...ends), Math.max(...ends)]
    return { start: this.whole[0], end: this.whole[1] }
  }

  async length() {
    const asked = new URLSearchParams({ names: this.names.slice(0, 1).join(','), points: POINTS })
    return this.names.length ? this.learn((await get(`${this.path}/signals?${asked}`, this.signal)).signals) : { start: 0, end: 0 }
  }

  get path() {
    return `/api/flights/${encodeURIComponent(this.summary.id)}`
  }

  async fetch() {
    const spectrum = this.way === 'spectrum'
    const asked = new URLSearchParams({ names: this.names.join(','),
      ...(spectrum ? {} : { points: this.way === 'xy' ? Math.min(FINE, Math.floor(400_000 / this.names.length)) : POINTS }) })
    if (this.range) {
      const margin = spectrum || this.way === 'xy' ? 0 : 0.02 * (this.range.end - this.range.start)
      asked.set('start', this.range.start - margin)
      asked.set('end', this.range.end + margin)
    }
    return (await get(`${this.path}/${spectrum ? 'spectrum' : 'signals'}?${asked}`, this.signal)).signals
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
    for (const { range } of this.shown) range?.setv(this.range)
    this.showSpan()
    clearTimeout(this.timer)
    this.timer = setTimeout(() => this.refresh(), PATIENCE_MS)
  }

  async refresh() {
    this.query.set('start', this.range.start.toFixed(3))
    this.query.set('end', this.range.end.toFixed(3))
    try {
      if (this.way === 'xy' || this.way === 'spectrum') {
        await this.draw(this.names)
      } else {
        const serial = ++this.serial
        const found = await this.fetch()
        if (serial !== this.serial) return
        this.found = found
        for (const plot of this.shown) plot.take(found)
      }
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

  /** Identify the stretch that is shown. */
  async identify(button) {
    button.disabled = true
    try {
      const { start, end } = this.range
      const job = await post(`${this.path}/jobs`, { kind: 'identify', from: Math.max(start, 0), to: end })
      this.begun(job)
      announce(`An identification of ${this.span.textContent} was started; it stands below.`, true)
    } catch (error) {
      announce(error.message, true)
    } finally {
      button.disabled = false
    }
  }

  /** What is drawn, as a table: a row for each sample of any signal. */
  table() {
    const rows = new Map()
    this.names.forEach((name, column) => {
      const { time, frequency, value, unit } = this.found[name]
      const factor = time ? shownUnit(unit)[1] : 1
      ;(time ?? frequency).forEach((at, i) => {
        if (!rows.has(at)) rows.set(at, [])
        rows.get(at)[column] = value[i] === null ? '' : value[i] * factor
      })
    })
    const across = this.way === 'spectrum' ? 'frequency_Hz' : 'time_s'
    const head = [across, ...this.names.map(name => `${name} [${this.way === 'spectrum' ? this.found[name].unit : shownUnit(this.found[name].unit)[0]}]`)]
    const lines = [...rows.keys()].sort((a, b) => a - b).map(at => [at, ...this.names.map((_, i) => rows.get(at)[i] ?? '')].join(','))
    hand(new Blob([[head.join(','), ...lines, ''].join('\n')], { type: 'text/csv' }), `${this.summary.id}.csv`)
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
      button('Whole flight', 'Whole flight', () => this.all()), this.span,
      h('button', { type: 'button', click: event => this.identify(event.target) }, 'Identify this stretch'),
      h('button', { type: 'button', click: () => this.table() }, 'Values (CSV)'))
  }
}
