// The plots of a flight's signals: what is fetched, the stretch of time they share, and what one does with them.

import { aborted, asking, get, hand, post, sentence } from '../shared/api.js'
import { announce } from '../shared/announce.js'
import { Cursor } from './cursor.js'
import { h } from '../shared/dom.js'
import { number, shownUnit, signalName } from '../shared/format.js'
import { draggable, tools } from './plottools.js'
import { bokeh } from '../shared/plots.js'
import { keepQuery } from '../shared/router.js'
import { againstEachOther, byUnit, overTime, spectra, spectrograms } from './signalplots.js'

const POINTS = 1000
const FINE = 20_000
const PATIENCE_MS = 150
// What is drawn over another axis than time.
/** @type {Record<string, typeof spectra | typeof spectrograms | typeof againstEachOther>} */
const WAYS = { spectrum: spectra, spectrogram: spectrograms, xy: againstEachOther }

/** The plots below each other, over one range of time. */
export class Drawing {
  /**
   * query: the address's parameters, which keep stretch and way. begun: called with a job for the stretch that is
   * shown.
   * regroup: called with which signals stand in which plot when somebody has changed that.
   * @param {FlightSummary} summary
   * @param {URLSearchParams} query
   * @param {AbortSignal} signal
   * @param {TakeJob} begun
   * @param {(groups: string[][]) => Promise<void>} regroup
   */
  constructor(summary, query, signal, begun, regroup) {
    this.summary = summary
    this.query = query
    this.signal = signal
    this.begun = begun
    this.regroup = regroup
    /** @type {SignalPlot[]} */
    this.shown = []
    this.serial = 0
    this.whole = [0, Infinity]
    /** @type {string[][]} */
    this.groups = []
    /** @type {Record<string, any>} series, spectra or spectrograms by name */
    this.found = {}
    /** @type {{ start: number, end: number } | null} until something is drawn */
    this.range = null
    this.way = ''
    this.place = h('div', { class: 'plots' })
    this.cursor = new Cursor()
    this.shaded = h('p', { class: 'hint' },
      summary.used.length ? 'Shaded green: the parts that the model was made from.' : '')
    this.span = h('output', { class: 'span' })
  }

  get names() {
    return this.groups.flat()
  }

  /** Whether the way that is chosen shows all signals over one axis of time, with a cursor through them. */
  get timed() {
    return this.way === '' || this.way === 'together'
  }

  /** groups: the names of the signals of each plot. @param {string[][]} groups */
  async draw(groups) {
    const serial = ++this.serial
    await bokeh()
    // What is shown stays as it is, and can be used, until all of the new is there.
    const { query, summary } = this
    const names = groups.flat()
    const way = query.get('as') ?? ''
    const asked = query.has('end') ? { start: Number(query.get('start')), end: Number(query.get('end')) } : null
    const found = names.length ? await this.fetch(names, way, asked) : {}
    if (serial !== this.serial) return
    const range = asked ?? (way.startsWith('spectr') ? await this.length(names) : this.learn(found))
    if (serial !== this.serial) return
    this.stop?.abort()
    const stop = this.stop = new AbortController()
    this.signal.addEventListener('abort', () => stop.abort())
    const over = () => overTime(way === 'together' ? byUnit(names, found) : groups, found, range, summary,
      changed => this.moved(changed), stop.signal)
    const shown = await (Object.hasOwn(WAYS, way) ? WAYS[way](names, found, stop.signal) : over())
    if (serial !== this.serial) return
    Object.assign(this, { groups, way, range, found, shown })
    for (const [index, { element, names: drawn }] of this.shown.entries()) {
      element.append(tools(element, `${summary.id}-${drawn.join('-')}`, way === '' ? this.moves(index) : []))
      if (way === '') draggable(element, index, (from, to) => this.join(from, to))
    }
    this.place.replaceChildren(...this.shown.map(({ element }) => element))
    this.cursor.element.hidden = this.shaded.hidden = !this.timed
    this.cursor.show(this.timed ? /** @type {TimedPlot[]} */ (this.shown) : [])
    this.showSpan()
  }

  /** Draw the signals of one plot in another. @param {number} from @param {number} to */
  join(from, to) {
    const joined = this.groups.map((group, index) =>
      index === to ? [...group, ...this.groups[from]] : index === from ? [] : group)
    announce(`${this.groups[from].map(signalName).join(', ')}: drawn with `
      + `${this.groups[to].map(signalName).join(', ')}`)
    return this.regroup(joined)
  }

  /** What can be done with the place of a plot: [words, act] of each. @param {number} index @returns {Move[]} */
  moves(index) {
    const { groups } = this
    const others = groups.map((group, to) => /** @type {Move} */ (
      [`Draw with ${group.map(signalName).join(', ')}`, () => this.join(index, to)])).filter((_, to) => to !== index)
    /** @type {Move[]} */
    const apart = groups[index].length > 1
      ? [['Draw each in a plot of its own',
        () => this.regroup(groups.flatMap((group, at) => at === index ? group.map(name => [name]) : [group]))]] : []
    return [...apart, ...others]
  }

  /**
   * The flight from its first to its last sample; a vehicle's clock may run at another pace than ours.
   * @param {Record<string, Series>} found
   */
  learn(found) {
    const ends = Object.values(found).filter(series => series.time.length)
      .flatMap(({ time }) => [time[0], time[time.length - 1]])
    if (ends.length) this.whole = [Math.min(...ends), Math.max(...ends)]
    return { start: this.whole[0], end: this.whole[1] }
  }

  /** @param {string[]} names */
  async length(names) {
    const asked = asking({ names: names.slice(0, 1).join(','), points: POINTS })
    return names.length ? this.learn((await get(`${this.path}/signals?${asked}`, this.signal)).signals)
      : { start: 0, end: 0 }
  }

  get path() {
    return `/api/flights/${encodeURIComponent(this.summary.id)}`
  }

  /**
   * @param {string[]} names
   * @param {string} way
   * @param {{ start: number, end: number } | null} range
   * @returns {Promise<Record<string, any>>} series or, by the way, spectra or spectrograms
   */
  async fetch(names, way, range) {
    const spectral = way.startsWith('spectr')
    const points = way === 'xy' ? Math.min(FINE, Math.floor(400_000 / names.length)) : POINTS
    const margin = range && !spectral && way !== 'xy' ? 0.02 * (range.end - range.start) : 0
    const asked = asking({ names: names.join(','), ...(spectral ? {} : { points }),
      ...(range ? { start: range.start - margin, end: range.end + margin } : {}) })
    return (await get(`${this.path}/${spectral ? way : 'signals'}?${asked}`, this.signal)).signals
  }

  /** Back to all of the flight. */
  all() {
    this.query.delete('start')
    this.query.delete('end')
    return this.draw(this.groups).then(() => keepQuery(this.query))
  }

  /** All plots follow the one whose range has changed. @param {{ start: number, end: number }} range */
  moved({ start, end }) {
    if (start === this.range?.start && end === this.range?.end) return
    this.range = { start, end }
    for (const { range } of this.shown) range?.setv(this.range)
    this.showSpan()
    clearTimeout(this.timer)
    this.timer = setTimeout(() => this.refresh(), PATIENCE_MS)
  }

  async refresh() {
    if (!this.range) return
    this.query.set('start', this.range.start.toFixed(3))
    this.query.set('end', this.range.end.toFixed(3))
    try {
      if (!this.timed) {
        await this.draw(this.groups)
      } else {
        const serial = ++this.serial
        const found = await this.fetch(this.names, this.way, this.range)
        if (serial !== this.serial) return
        this.found = found
        for (const plot of this.shown) plot.take?.(found)
      }
      keepQuery(this.query)
    } catch (error) {
      if (!aborted(error)) announce(sentence(error), true)
    }
  }

  showSpan() {
    if (!this.range) return
    this.span.textContent = `${number(this.range.start, 4)} to ${number(this.range.end, 4)} s`
  }

  /** Show the stretch from start to end, s, kept within the flight. @param {number} start @param {number} end */
  look(start, end) {
    const [begin, finish] = this.whole
    const length = Math.min(end - start, finish - begin)
    const first = Math.min(Math.max(start, begin), finish - length)
    this.moved({ start: first, end: first + length })
    announce(`Shown: ${this.span.textContent}`)
  }

  /** Identify the stretch that is shown. @param {HTMLButtonElement} button */
  async identify(button) {
    if (!this.range) return
    button.disabled = true
    try {
      const { start, end } = this.range
      const job = await post(`${this.path}/jobs`, { kind: 'identify', from: Math.max(start, 0), to: end })
      this.begun(job)
      announce(`An identification of ${this.span.textContent} was started; it stands below.`, true)
    } catch (error) {
      announce(sentence(error), true)
    } finally {
      button.disabled = false
    }
  }

  /** What is drawn, as a table: a row for each sample of any signal. */
  table() {
    if (this.way === 'spectrogram') return this.tableOverTime()
    /** @type {Map<number, (string | number)[]>} */
    const rows = new Map()
    this.names.forEach((name, column) => {
      const { time, frequency, value, unit } = this.found[name]
      const factor = time ? shownUnit(unit)[1] : 1
      ;/** @type {number[]} */ (time ?? frequency).forEach((at, i) => {
        const row = rows.get(at) ?? []
        rows.set(at, row)
        row[column] = value[i] === null ? '' : value[i] * factor
      })
    })
    const across = this.way === 'spectrum' ? 'frequency_Hz' : 'time_s'
    const head = [across, ...this.names.map(name =>
      `${name} [${this.way === 'spectrum' ? this.found[name].unit : shownUnit(this.found[name].unit)[0]}]`)]
    const lines = [...rows.keys()].sort((a, b) => a - b).map(at =>
      [at, ...this.names.map((_, i) => rows.get(at)?.[i] ?? '')].join(','))
    hand(new Blob([[head.join(','), ...lines, ''].join('\n')], { type: 'text/csv' }), `${this.summary.id}.csv`)
  }

  /** Spectrograms as a table: a row for each moment and frequency. */
  tableOverTime() {
    const lines = this.names.flatMap(name => {
      /** @type {Spectrogram} */
      const { time, frequency, value } = this.found[name]
      return time.flatMap((at, column) =>
        frequency.map((hz, row) => [name, at, hz, value[row][column] ?? ''].join(',')))
    })
    hand(new Blob([['signal,time_s,frequency_Hz,density_dB', ...lines, ''].join('\n')], { type: 'text/csv' }),
      `${this.summary.id}.csv`)
  }

  controls() {
    const zoom = (/** @type {number} */ factor) => () => {
      if (!this.range) return
      const { start, end } = this.range
      const [middle, half] = [(start + end) / 2, factor * (end - start) / 2]
      this.look(middle - half, middle + half)
    }
    const move = (/** @type {number} */ share) => () => {
      if (!this.range) return
      const { start, end } = this.range
      this.look(start + share * (end - start), end + share * (end - start))
    }
    /** @param {string} text @param {string} label @param {() => void} click */
    const button = (text, label, click) => h('button', { type: 'button', 'aria-label': label, click }, text)
    return h('div', { class: 'row', role: 'group', 'aria-label': 'Stretch of time' },
      button('+', 'Zoom in', zoom(0.5)), button('−', 'Zoom out', zoom(2)),
      button('◀', 'Earlier', move(-0.5)), button('▶', 'Later', move(0.5)),
      button('Whole flight', 'Whole flight', () => this.all()), this.span,
      h('button', { type: 'button', click: event => this.identify(event.target) }, 'Identify this stretch'),
      h('button', { type: 'button', click: () => this.table() }, 'Values (CSV)'))
  }
}
