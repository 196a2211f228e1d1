// The view while the aircraft flies: state, instruments, plots, links, coefficients, warnings.

import { announce } from './announce.js'
import { get } from './api.js'
import { h, remark } from './dom.js'
import { duration } from './format.js'
import { Identification } from './liveidentification.js'
import { Instruments } from './instruments.js'
import { Links } from './livelinks.js'
import { LivePlots } from './liveplots.js'
import { follow } from './stream.js'

const LINKS_MS = 2000

const STATES = {
  live: ['good', data => `Live: flight ${data.flight ?? ''}${data.vehicle ? ` of ${data.vehicle}` : ''}, ${duration(data.time_s)}`],
  lost: ['bad', data => `No message from the vehicle${data.time_s === null ? '' : ` since ${duration(data.time_s)} of the flight`}. `
    + 'Check its power, the radio, and the links below.'],
  waiting: ['note', () => 'Waiting for the first message. Switch the vehicle on; if nothing comes, see the links below.'],
}

/** The live view; it never ends by itself. */
export async function live(page, parts, query, signal) {
  const view = new LiveView(query, signal)
  let newest
  try {
    newest = await get('/api/live', signal)
  } catch (error) {
    if (error.status === 401 || error.name === 'AbortError') throw error
    newest = null
    view.disconnected(error.message)
  }
  page.append(h('h1', {}, 'Live'), view.banner, view.warnings, ...view.instruments.elements, ...view.plots.elements,
    ...view.identification.elements, ...view.links.elements)
  if (newest) view.take(newest)
  view.start()
}

class LiveView {
  constructor(query, signal) {
    this.signal = signal
    this.banner = h('p', { class: 'remark note banner', role: 'status' }, 'Asking the ground station …')
    this.warnings = h('div', { 'aria-live': 'polite' })
    this.instruments = new Instruments()
    this.plots = new LivePlots(query, signal)
    this.identification = new Identification(signal)
    this.links = new Links()
    this.data = { state: 'waiting', time_s: null }
    this.stateEvents = 0
  }

  /** Take an object of GET /api/live. */
  take(newest) {
    this.data = newest
    const values = Object.fromEntries(Object.entries(newest.signals).map(([name, entry]) => [name, entry.value]))
    this.plots.units(newest.signals)
    this.signals({ time_s: newest.time_s, signals: values })
    this.estimate(newest.identification, newest.why)
    this.state(newest)
  }

  state(change) {
    if (change.flight !== undefined && change.flight !== this.data.flight) {
      this.plots.clear()
      this.identification.clear()
    }
    Object.assign(this.data, change)
    const [kind, words] = STATES[this.data.state]
    this.tell(kind, words(this.data))
  }

  tell(kind, text) {
    if (this.told === text) return
    this.told = text
    this.banner.className = `remark ${kind} banner`
    this.banner.textContent = text
  }

  disconnected(reason) {
    this.broken = true
    this.instruments.stale(true)
    this.tell('bad', `The connection to the ground station is lost: ${reason}. It is tried again by itself.`)
  }

  signals(event) {
    this.data.time_s = event.time_s
    this.instruments.show(event.signals)
    if (this.plots.knows(event.signals)) this.plots.add(event)
    else this.askUnits()
  }

  /** Events carry no units, the snapshot does. */
  async askUnits() {
    if (this.asking) return
    this.asking = true
    try {
      this.plots.units((await get('/api/live', this.signal)).signals)
    } catch (error) {
      if (!this.signal.aborted) announce(error.message)
    } finally {
      this.asking = false
    }
  }

  estimate(found, why) {
    this.identification.show(found, why, this.data.time_s)
    const warnings = found?.warnings ?? []
    const changes = (found?.changes ?? []).map(one => one.text)
    const key = JSON.stringify([warnings, changes])
    if (key === this.shownWarnings) return
    this.shownWarnings = key
    this.warnings.replaceChildren(...changes.map(text => remark('bad', h('p', {}, text))),
      ...warnings.map(text => remark('note', h('p', {}, text))))
  }

  start() {
    const { signal } = this
    this.showLinks()
    follow('/api/live/stream', signal, {
      event: (name, data) => {
        if (name === 'signals') this.signals(data)
        else if (name === 'estimate') this.estimate(data)
        else if (name === 'state') {
          this.stateEvents += 1
          this.state(data)
        }
      },
      state: reason => reason ? this.disconnected(reason) : this.connected(),
    }).catch(error => {
      if (!signal.aborted) this.disconnected(error.message)
    })
    const clock = setInterval(() => {
      if (!this.broken && this.data.state === 'live') this.state({})
    }, 1000)
    signal.addEventListener('abort', () => clearInterval(clock))
  }

  /** The stream is there: what happened meanwhile is asked for. */
  async connected() {
    if (this.broken) announce('Connected to the ground station again')
    this.broken = false
    this.instruments.stale(false)
    const before = this.stateEvents
    try {
      const newest = await get('/api/live', this.signal)
      // An event that came while this answer was under way is newer than the answer.
      if (this.stateEvents !== before) Object.assign(newest, { state: this.data.state, flight: this.data.flight })
      this.take(newest)
    } catch (error) {
      if (!this.signal.aborted) this.disconnected(error.message)
    }
  }

  async showLinks() {
    try {
      this.links.show(await get('/api/links', this.signal))
    } catch (error) {
      if (this.signal.aborted) return
      this.links.fail(error.message)
    }
    const timer = setTimeout(() => this.showLinks(), LINKS_MS)
    this.signal.addEventListener('abort', () => clearTimeout(timer))
  }
}
