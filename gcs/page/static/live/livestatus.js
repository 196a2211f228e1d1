// One line of what may end a flight: mode, arming, battery, GPS, link, recording. Words beside colours, always.

import { h } from '../shared/dom.js'
import { NONE, percent, size } from '../shared/format.js'
import { write } from './livetable.js'

// Below this share of its charge, and this much free space, something is to be done.
const LOW_BATTERY = 0.25
const LITTLE_SPACE = 1e9
const MUCH_LOST = 0.02

/** @typedef {{ kind: string, text: string }} Shown */

// What the vehicle itself says: old where nothing comes from it any more.
const OF_VEHICLE = new Set(['Mode', 'Motor', 'Battery', 'GPS'])

/** By name of the chip, what stands in it. @type {[string, (known: LiveKnown) => Shown | null][]} */
const CHIPS = [
  ['Mode', ({ status }) => status.mode ? { kind: '', text: status.mode } : null],
  ['Motor', ({ status }) => status.mode === undefined ? null
    : status.armed ? { kind: 'warn', text: 'ARMED' } : { kind: 'fine', text: 'disarmed' }],
  ['Battery', ({ status }) =>
    status.battery ? battery(status.battery) : status.mode === undefined ? null : { kind: '', text: 'not sent' }],
  ['GPS', ({ status }) => status.gps ? gps(status.gps) : null],
  ['Radio', ({ links }) => links ? radio(links) : null],
  ['Recording', ({ flight, health }) => health ? recording(flight, health) : null],
]

/** @param {Battery} battery */
function battery({ voltage_v: volt, current_a: ampere, remaining }) {
  const parts = [volt === undefined ? '' : `${volt.toFixed(1)} V`, ampere === undefined ? '' : `${ampere.toFixed(1)} A`,
    remaining === undefined ? '' : percent(remaining)]
  const low = remaining !== undefined && remaining < LOW_BATTERY
  return { kind: low ? 'alarm' : '', text: `${parts.filter(Boolean).join(', ')}${low ? ', low' : ''}` }
}

/** @param {Gps} gps */
function gps({ fix, good, satellites }) {
  const seen = satellites === null || satellites === undefined ? '' : `, ${satellites} sat.`
  return { kind: good ? '' : 'alarm', text: `${fix}${seen}` }
}

/** @param {Link[]} links */
function radio(links) {
  const components = links.flatMap(link => link.systems.flatMap(system => system.components))
  const [lost, received] = /** @type {const} */ (['lost', 'received']).map(key =>
    components.reduce((sum, one) => sum + one[key], 0))
  const rate = links.reduce((sum, link) => sum + link.frames_per_s, 0)
  if (!received) return { kind: 'warn', text: 'nothing heard' }
  const share = lost / (lost + received)
  return { kind: share > MUCH_LOST ? 'alarm' : '', text: `${Math.round(rate)}/s, ${percent(share)} lost` }
}

/** @param {string | null | undefined} flight @param {Health} health */
function recording(flight, { disk_free_bytes: free, problem }) {
  const space = `${size(free)} free`
  if (problem) return { kind: 'alarm', text: 'trouble, see below' }
  if (free < LITTLE_SPACE) return { kind: 'alarm', text: space }
  return flight ? { kind: 'fine', text: `on, ${space}` } : { kind: '', text: `off, ${space}` }
}

/** The chips. */
export class Status {
  constructor() {
    /** @type {LiveKnown} */
    this.known = { status: {}, links: null, health: null, flight: null, old: false }
    this.chips = CHIPS.map(([title, shown]) => {
      const text = h('dd', {}, NONE)
      const element = h('div', { class: 'chip', hidden: true }, h('dt', {}, title), text)
      return { element, text, shown, title }
    })
    this.element = h('dl', { class: 'strip', tabindex: '0' }, this.chips.map(one => one.element))
  }

  /**
   * Take what is new: `status` of the vehicle, whether that is `old`, `links`, `health` of the station, id of the
   * `flight` being recorded.
   * @param {Partial<LiveKnown>} change
   */
  take(change) {
    Object.assign(this.known, change)
    for (const { element, text, shown, title } of this.chips) {
      const found = shown(this.known)
      element.hidden = !found
      if (!found) continue
      const old = this.known.old && OF_VEHICLE.has(title)
      element.className = `chip ${old ? 'dated' : found.kind}`
      write(text, old ? `${found.text} (old)` : found.text)
    }
  }

  /** Another flight: nothing is known of its vehicle. */
  clear() {
    this.take({ status: {} })
  }
}
