// Tables of estimates with their error bars drawn beside the numbers.

import { h, svg, table } from '../shared/dom.js'
import { estimate, interval, NONE, number, percent, plusMinus, shownUnit } from '../shared/format.js'
import { meaning } from './meanings.js'

const [WIDTH, HEIGHT, EDGE] = [180, 28, 8]

/** Coefficients and effect parameters of a model that have a value: [name, entry] pairs. @param {Model} model */
export function estimated(model) {
  const entries = Object.entries(model.coefficients)
  for (const effect of model.effects ?? []) {
    for (const [name, entry] of Object.entries(effect.parameters ?? {})) entries.push([`${effect.name}.${name}`, entry])
  }
  return entries.filter(([, entry]) => Number.isFinite(entry.value))
}

/**
 * A small drawing of estimates on one scale: a dot each and its 95 % interval.
 * from0: the scale begins or ends at zero, which is marked. It only repeats the numbers beside it.
 * @param {Coefficient[]} entries
 */
export function bars(entries, from0 = true) {
  const reach = entries.flatMap(entry => interval(entry) ?? [entry.value]).concat(from0 ? [0] : [])
  const [low, high] = [Math.min(...reach), Math.max(...reach)]
  /** @param {number} value */
  const at = value => EDGE + (WIDTH - 2 * EDGE) * (high > low ? (value - low) / (high - low) : 0.5)
  const rows = entries.map((entry, index) => {
    const y = HEIGHT * (index + 0.5) / entries.length
    const ends = interval(entry)
    /** @type {SVGElement[]} */
    const marks = [svg('circle', { cx: at(entry.value), cy: y, r: 4, class: `dot${index}` })]
    if (ends) {
      const [left, right] = ends.map(at)
      marks.push(svg('path',
        { class: `bar${index}`, d: `M${left} ${y}H${right}M${left} ${y - 5}v10M${right} ${y - 5}v10` }))
    }
    return marks
  })
  return svg('svg',
    { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, width: WIDTH, height: HEIGHT, 'aria-hidden': 'true', class: 'bars' },
    from0 && svg('path', { class: 'zero', d: `M${at(0)} 0V${HEIGHT}` }), ...rows.flat())
}

/** @param {Coefficient} entry */
const between = entry => {
  const ends = interval(entry)
  return ends ? ends.map(end => estimate(end, entry.std)).join('\u00a0…\u00a0') : NONE
}

/**
 * Every coefficient estimated, with 95 % interval, relative error and what of it is the flight's.
 * @param {Model} model
 */
export function coefficientTable(model) {
  const head = ['Coefficient', 'Value ± 1 σ', '95 % interval', '0 and the interval', 'Relative σ',
    'σ of the flight alone']
  const whole = estimated(model).some(([, entry]) => entry.statistical_std !== undefined)
  return table(whole ? 'Coefficients. σ and interval hold all: what the flight leaves open, and what the vehicle file '
    + 'may be wrong by' : 'Coefficients',
    head, estimated(model).map(([name, entry]) =>
      [h('span', {}, h('code', {}, name), h('small', { class: 'meaning' }, meaning(name))), plusMinus(entry),
        between(entry), bars([entry]),
        entry.std && entry.value ? percent(entry.std / Math.abs(entry.value)) : NONE,
        number(entry.statistical_std, 2)]), true)
}

/** Sensor errors with their units. @param {Record<string, Estimate>} errors */
export const sensorTable = errors => table(
  'Errors of the sensors: measured = (1 + scale) true + bias; wind is the velocity of the air',
  ['Error', 'Value ± 1 σ', '95 % interval', '0 and the interval', 'Unit'],
  Object.entries(errors).map(([name, entry]) => {
    const [unit, factor] = shownUnit(entry.unit || '1')
    const seen = { value: factor * entry.value, std: factor * entry.std }
    return [h('code', {}, name), plusMinus(seen), between(seen), bars([seen]), unit]
  }), true)

/** What was refused, why, and what to fly. @param {Refused[]} refused */
export const refusedTable = refused => table('Refused: not identifiable from this flight',
  ['Name', 'Reason', 'Manoeuvre that would identify it'],
  refused.map(one => [h('span', {}, h('code', {}, one.name), h('small', { class: 'meaning' }, meaning(one.name))),
    one.reason, one.manoeuvre || NONE]), true)
