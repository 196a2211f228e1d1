// The view while the aircraft flies: state, instruments, plots, links, coefficients, warnings.

import { announce } from '../shared/announce.js'
import { aborted, get, sentence, statusOf } from '../shared/api.js'
import { h } from '../shared/dom.js'
import { duration } from '../shared/format.js'
import { FlyNext } from './flynext.js'
import { Identification } from './liveidentification.js'
import { Instruments } from './instruments.js'
import { Links } from './livelinks.js'
import { Notes } from './livenotes.js'
import { LivePlots } from './liveplots.js'
import { Status } from './livestatus.js'
import { write } from './livetable.js'
import { Track } from './livetrack.js'
import { Warnings } from './livewarnings.js'
import { follow } from '../shared/stream.js'

const LINKS_MS = 2000
// The service sends signals ten times a second while messages come.
const SILENT_MS = 3000
// A value older than this by the snapshot is no longer sent in events.
const FRESH_S = 2

/** @typedef {LiveState & { time_s: number | null, heard?: boolean }} LiveData */

/** @type {Record<string, [string, (data: LiveData) => string]>} */
const STATES = {
  live: ['good', data => `Live${data.vehicle ? `: ${data.vehicle}` : ''}`],
  late: ['bad',
    () => 'Nothing new has come for some seconds: the ground station is behind, or this device is losing it. The '
      + 'figures are old.'],
  lost: ['bad',
    data => `No message from the vehicle${data.time_s === null
      ? '' : ` since ${duration(data.time_s)} of the flight`}. `
      + 'Check its power, the radio, and the links below.'],
  landed: ['note', data => `Flight over: the vehicle is disarmed${data.state === 'live' ? ' and still sends' : ''}.`],
  down: ['note', () => 'Flight over: the vehicle came down and sends no more.'],
  silent: ['bad',
    () => 'Nothing more was heard of the vehicle, and its flight has ended. If it comes back, that is another flight.'],
  waiting: ['note', data => data.heard
    ? 'Messages come and are recorded; the ground station still prepares to show them. The first time that takes a '
      + 'minute.'
    : 'Waiting for the first message. Switch the vehicle on; if nothing comes, see the links below.'],
}

// Within so many m of where it took off an aircraft that falls silent has landed.
const ON_GROUND_M = 15
const OUTCOME_MS = 2000, OUTCOME_FOR_MS = 900_000
const VERDICTS = { good: 'The flight is good for identification.', care: 'The flight is usable with care.',
  poor: 'The flight is too poor for a model.' }

/** Whether a flight began on the ground, flew, and was near it at the end. @param {Outline | null} outline */
function cameDown(outline) {
  const values = outline && ['height', 'altitude'].includes(outline.name) ? outline.values : []
  const heights = values.filter(value => value !== null)
  const ground = Math.min(...heights)
  return heights.length > 2 && heights[0] - ground < ON_GROUND_M && heights[heights.length - 1] - ground < ON_GROUND_M
    && Math.max(...heights) - ground > 2 * ON_GROUND_M
}

/** What came of a flight's identification, in words. @param {Outcome | null} outcome */
function outcomeWords(outcome) {
  if (!outcome) return ''
  if (outcome.verdict) return VERDICTS[outcome.verdict] ?? ''
  return ['queued', 'running'].includes(outcome.state ?? '') ? 'Its identification is running.' : outcome.text ?? ''
}

/**
 * The live view; it never ends by itself.
 * @param {HTMLElement} page
 * @param {string[]} parts
 * @param {URLSearchParams} query
 * @param {AbortSignal} signal
 */
export async function live(page, parts, query, signal) {
  const view = new LiveView(query, signal)
  /** @type {Live | null} */
  let newest
  try {
    newest = await get('/api/live', signal)
  } catch (error) {
    if (statusOf(error) === 401 || aborted(error)) throw error
    newest = null
    view.disconnected(sentence(error))
  }
  page.append(h('h1', { class: 'unseen' }, 'Live'), view.banner, view.status.element, view.first, view.warnings.element,
    h('div', { class: 'cockpit' }, h('div', {}, ...view.instruments.elements, view.next.element, view.notes.element),
      view.track.element),
    ...view.plots.elements, ...view.identification.elements, ...view.links.elements)
  if (newest) view.take(newest)
  view.start()
}

class LiveView {
  /** @param {URLSearchParams} query @param {AbortSignal} signal */
  constructor(query, signal) {
    this.signal = signal
    // Only a change of state is announced; the running time beside it is not.
    this.words = h('p', { role: 'status' }, 'Asking the ground station …')
    this.clock = h('p', { class: 'clock' })
    this.outcome = h('p', { role: 'status' })
    this.result = h('a', { class: 'button', hidden: true }, 'See what came of it')
    this.banner = h('div', { class: 'remark note banner' }, this.words, this.clock, this.outcome, this.result)
    this.first = h('section', { class: 'panel', hidden: true, 'aria-label': 'With a log' },
      h('p', {}, 'With a log on a card no vehicle is needed here: ',
        h('a', { href: '#/aircraft/new' }, 'describe the aircraft'), ', ',
        h('a', { href: '#/flights' }, 'take the log in'), ', and press Identify on its page.'))
    this.warnings = new Warnings()
    this.instruments = new Instruments()
    this.status = new Status()
    this.track = new Track(signal)
    this.notes = new Notes(signal)
    this.next = new FlyNext()
    this.plots = new LivePlots(query, signal)
    this.identification = new Identification(signal)
    this.links = new Links()
    /** @type {LiveData} */
    this.data = { state: 'waiting', time_s: null }
    /** @type {string | null} */
    this.flight = null
    this.followed = ''
    this.stateEvents = 0
    this.heard = Date.now()
  }

  /** Take an object of GET /api/live. @param {Live} newest */
  take(newest) {
    this.data.time_s = newest.time_s
    this.state({ state: newest.state, flight: newest.flight, vehicle: newest.vehicle, landed: newest.landed,
      silent: newest.silent })
    this.plots.units(newest.signals)
    const entries = Object.entries(newest.signals)
    // Of a vehicle that is silent all is old: how old then counts from what came last.
    const last = newest.state === 'live' ? 0 : Math.min(...entries.map(([, entry]) => entry.age_s))
    /** @param {string} name */
    const age = name => newest.signals[name].age_s - last
    this.instruments.show(Object.fromEntries(entries.map(([name, entry]) => [name, entry.value])), age)
    const fresh = entries.filter(([name]) => age(name) < FRESH_S).map(([name, entry]) => [name, entry.value])
    this.plots.add({ time_s: newest.time_s, signals: Object.fromEntries(fresh) })
    this.track.fill(newest.track, newest.status.home?.place)
    this.vehicle(newest.status)
    this.estimate(newest.identification, newest.why)
  }

  /** @param {LiveState} change */
  state(change) {
    if (change.flight && change.flight !== this.flight) {
      this.flight = change.flight
      this.learnt = false
      for (const part of [this.plots, this.identification, this.instruments, this.warnings, this.status, this.track,
        this.notes, this.next]) part.clear()
    }
    if ('flight' in change) this.status.take({ flight: change.flight })
    Object.assign(this.data, change)
    this.look()
  }

  /**
   * The state's name: what is late hides that the flight is over, and that hides silence.
   * @param {boolean} late
   * @param {string | false | null} [silent]
   */
  named(late, silent) {
    if (late) return 'late'
    if (this.data.landed) return 'landed'
    if (!silent) return this.data.state
    return this.down === this.data.silent ? 'down' : 'silent'
  }

  /** Show the state as it is now: old figures must not look like new ones. */
  look() {
    if (this.broken) return
    const late = this.data.state === 'live' && Date.now() - this.heard > SILENT_MS
    const silent = this.data.state !== 'live' && this.data.silent
    const [kind, words] = STATES[this.named(late, silent)]
    const over = this.data.landed || silent
    this.first.hidden = this.data.state !== 'waiting' || Boolean(over)
    this.result.hidden = this.outcome.hidden = !over || late
    if (over) {
      this.result.href = `#/flights/${encodeURIComponent(over)}`
      this.next.show(null)
      this.follow(over)
    }
    const old = late || this.data.state !== 'live'
    this.instruments.element.classList.toggle('over', kind === 'note')
    this.instruments.stale(old)
    if (old !== this.status.known.old) this.status.take({ old })
    this.showState(kind, words(this.data),
      this.data.state === 'live' && this.data.time_s !== null ? `at ${duration(this.data.time_s)}` : '')
    this.banner.title = this.data.flight ? `flight ${this.data.flight}` : ''
  }

  /** Ask what came of a flight that is over, until it is known. @param {string} flight */
  async follow(flight) {
    if (this.followed === flight) return
    this.followed = flight
    write(this.outcome, '')
    const until = Date.now() + OUTCOME_FOR_MS
    for (let known = false; !known && this.followed === flight && !this.signal.aborted;) {
      try {
        /** @type {FlightSummary} */
        const { outcome, outline } = await get(`/api/flights/${encodeURIComponent(flight)}`, this.signal)
        if (this.followed !== flight) return
        if (cameDown(outline)) this.down = flight
        this.look()
        write(this.outcome, outcomeWords(outcome))
        known = Boolean(outcome?.verdict) || Date.now() > until
          || ['done', 'failed', 'skipped', 'cancelled'].includes(outcome?.state ?? '')
      } catch (error) {
        if (this.signal.aborted) return
      }
      if (!known) await new Promise(done => setTimeout(done, OUTCOME_MS))
    }
  }

  /** @param {string} kind @param {string} text */
  showState(kind, text, time = '') {
    this.banner.className = `remark ${kind} banner`
    write(this.words, text)
    write(this.clock, time, 'clock')
  }

  /** @param {string} reason */
  disconnected(reason) {
    this.broken = true
    this.instruments.stale(true)
    this.showState('bad', `The connection to the ground station is lost: ${reason}. It is tried again automatically.`)
  }

  /** @param {SignalsEvent} event */
  signals(event) {
    this.data.time_s = event.time_s
    this.notes.time = event.time_s
    this.heard = Date.now()
    this.instruments.show(event.signals)
    this.next.feel(event.signals)
    if (this.plots.knows(event.signals)) this.plots.add(event)
    else this.askUnits()
  }

  /** The vehicle's own state: mode, battery, place, texts. @param {VehicleStatus} status */
  vehicle(status) {
    this.status.take({ status })
    this.track.show(status)
    this.notes.show(status.texts ?? [])
  }

  /** Events carry no units, the snapshot does. */
  async askUnits() {
    if (this.asking) return
    this.asking = true
    try {
      this.plots.units((await get('/api/live', this.signal)).signals)
    } catch (error) {
      if (!this.signal.aborted) announce(sentence(error))
    } finally {
      this.asking = false
    }
  }

  /** @param {LiveEstimate | null} found @param {string | null} [why] */
  estimate(found, why) {
    // What the vehicle sends on the ground after it has landed leaves standing what was learnt of its flight.
    if (this.data.landed && this.learnt) return
    this.learnt = Boolean(found)
    this.identification.show(found, why, this.data.time_s, Boolean(this.data.landed))
    this.next.show(this.data.landed ? null : found?.coefficients)
    this.warnings.show((found?.events ?? []).map(one => one.text), found?.warnings ?? [])
  }

  start() {
    const { signal } = this
    this.showLinks()
    follow('/api/live/stream', signal, {
      event: (name, data) => {
        this.broken = false
        if (name === 'signals') this.signals(data)
        else if (name === 'estimate') this.estimate(data)
        else if (name === 'status') this.vehicle(data)
        else if (name === 'state') {
          this.stateEvents += 1
          this.state(data)
        }
      },
      state: reason => reason ? this.disconnected(reason) : this.connected(),
    }).catch(error => {
      if (!signal.aborted) this.disconnected(error.message)
    })
    const clock = setInterval(() => this.look(), 1000)
    signal.addEventListener('abort', () => {
      clearInterval(clock)
      this.next.stop()
    })
  }

  /** The stream is there: what happened meanwhile is asked for. */
  async connected() {
    const before = this.stateEvents
    try {
      /** @type {[Live, Minute]} */
      const [newest, minute] = await Promise.all([get('/api/live', this.signal), get('/api/live/minute', this.signal)])
      // An event that came while this answer was under way is newer than the answer.
      if (this.stateEvents !== before)
        Object.assign(newest,
          { state: this.data.state, flight: this.data.flight, landed: this.data.landed, silent: this.data.silent })
      this.broken = false
      this.heard = Date.now()
      this.take(newest)
      if (!this.data.flight || minute.flight === this.data.flight) this.plots.fill(minute)
    } catch (error) {
      if (!this.signal.aborted) this.disconnected(sentence(error))
    }
  }

  async showLinks() {
    try {
      /** @type {[Link[], Health]} */
      const [links, health] = await Promise.all([get('/api/links', this.signal), get('/api/health', this.signal)])
      this.links.show(links)
      this.data.heard = links.some(link => link.frames_per_s > 0)
      this.status.take({ links, health })
    } catch (error) {
      if (this.signal.aborted) return
      this.links.fail(sentence(error))
    }
    const timer = setTimeout(() => this.showLinks(), LINKS_MS)
    this.signal.addEventListener('abort', () => clearTimeout(timer))
  }
}
