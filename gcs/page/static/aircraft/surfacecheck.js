// Which way does it go? Each control of an aircraft as its servos are commanded now, beside what the file makes of it.

import { h, remark } from '../shared/dom.js'
import { number } from '../shared/format.js'
import { follow } from '../shared/stream.js'

/** @type {Record<string, string>} */
const NAMES = { elevator: 'Elevator', aileron: 'Ailerons', rudder: 'Rudder', throttle: 'Throttle' }

/**
 * The section; it follows the vehicle once it is opened. controls: of the form, by name.
 * @param {Record<string, AircraftControl>} controls
 * @param {AbortSignal} signal
 */
export function surfaceCheck(controls, signal) {
  const names = Object.keys(controls)
  if (!names.length) return ''
  const rows = Object.fromEntries(names.map(name => [name, new Row(name, controls[name])]))
  const says = h('p', { role: 'status' }, 'Waiting for the vehicle …')
  let begun = false
  const begin = () => {
    if (begun) return
    begun = true
    follow('/api/live/stream', signal, {
      state: text => { if (text) says.textContent = text },
      event: (kind, data) => {
        if (kind !== 'signals') return
        const heard = names.map(name => rows[name].show(data.signals)).filter(Boolean).length
        says.textContent = heard
          ? 'Move each stick, and watch: does the surface go where the number says, and by as much?'
          : 'The vehicle sends no SERVO_OUTPUT_RAW of these servos.'
      },
    }).catch(error => { says.textContent = error.message })
  }
  return h('details', { toggle: event => event.target.open && begin() },
    h('summary', {}, 'Which way does it go? (with the vehicle switched on)'),
    remark('note',
      h('p', {}, 'The sign of a deflection is yours, as long as it stays the same. Usual: elevator and rudder '
        + 'positive with the trailing edge down and left, ailerons with the right one down.')),
    says, names.map(name => rows[name].element))
}

class Row {
  /** @param {string} name @param {AircraftControl} control */
  constructor(name, { servos }) {
    this.servos = servos
    this.unit = name === 'throttle' ? '%' : '°'
    const all = servos.flatMap(servo => servo.travel.map(value => value * servo.mix * servos.length))
    this.bar = h('meter', { min: Math.min(...all), max: Math.max(...all), value: 0, 'aria-label': NAMES[name] })
    this.words = h('span', { class: 'span' }, '–')
    this.element = h('p', { class: 'row' }, h('strong', {}, NAMES[name]), this.bar, this.words)
  }

  /** Show what the servos are commanded; whether all of them were heard. @param {Record<string, number>} signals */
  show(signals) {
    const pulses = this.servos.map(({ servo }) => signals[`servo${servo}`])
    if (pulses.some(pulse => !Number.isFinite(pulse))) return false
    const value = this.servos.reduce((sum, servo, index) =>
      sum + servo.mix * along(pulses[index], servo.pwm_us, servo.travel), 0)
    this.bar.value = value
    this.words.textContent = `${number(value, 3)} ${this.unit} at `
      + `${pulses.map(pulse => `${pulse.toFixed(0)} µs`).join(', ')}`
    return true
  }
}

/**
 * The value at x on a curve of points, held beyond its ends.
 * @param {number} x
 * @param {number[]} xs
 * @param {number[]} ys
 * @returns {number}
 */
export function along(x, xs, ys) {
  if (xs[0] > xs[xs.length - 1]) return along(x, xs.toReversed(), ys.toReversed())
  if (x <= xs[0]) return ys[0]
  for (let i = 1; i < xs.length; i++) {
    if (x <= xs[i]) return ys[i - 1] + (ys[i] - ys[i - 1]) * (x - xs[i - 1]) / (xs[i] - xs[i - 1])
  }
  return ys[ys.length - 1]
}
