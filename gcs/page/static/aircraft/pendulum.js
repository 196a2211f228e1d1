// Moments of inertia from swings: the aircraft hung up, pushed, and timed.

import { post, sentence } from '../shared/api.js'
import { field, h, select } from '../shared/dom.js'
import { number } from '../shared/format.js'

/** @type {Choice[]} */
const AXES = [['Iyy', 'pitch (Iyy)'], ['Ixx', 'roll (Ixx)'], ['Izz', 'yaw (Izz)']]

/**
 * Swings of a pendulum become a moment of inertia with its error.
 * numbers: of the form, which holds the mass. take: called with what was found, by the names of the form's numbers.
 * @param {Record<string, number>} numbers
 * @param {(made: Record<string, number>) => void} take
 */
export function swings(numbers, take) {
  /** @type {Record<string, string>} */
  const hint = { bifilar: 'of the two wires', swing: 'from the axis down to the centre of gravity' }
  const [length, spacing] = [0, 1].map(() => h('input', { type: 'number', step: 'any', min: 0 }))
  const times = h('input', { type: 'text', placeholder: '15.9, 15.7, 15.8', autocomplete: 'off' })
  const count = h('input', { type: 'number', min: 1, value: 10 })
  const lengthField = field('Length, m', length, hint.bifilar)
  const spacingField = field('Distance between the wires, m', spacing, 'Half on either side of the centre of gravity')
  const axis = select(AXES, 'Iyy')
  const way = select([['bifilar', 'hung on two wires, turned about the vertical'],
    ['swing', 'swung about an axis above it']], 'bifilar', value => {
      /** @type {Element} */ (lengthField.querySelector('.hint')).textContent = hint[value]
      spacingField.hidden = value === 'swing'
    })
  const says = h('p', { role: 'status' })
  const work = async () => {
    says.className = ''
    try {
      const found = await post('/api/vehicles/inertia', {
        way: way.value, mass_kg: numbers.mass_kg, length_m: Number(length.value), swings: Number(count.value),
        ...(numbers.mass_std_kg ? { mass_std_kg: numbers.mass_std_kg } : {}),
        ...(way.value === 'bifilar' ? { spacing_m: Number(spacing.value) } : {}),
        times_s: times.value.split(/[\s,;]+/).filter(Boolean).map(Number),
      })
      const made = { [`${axis.value}_kgm2`]: Number(found.value.toPrecision(4)),
        [`${axis.value}_std_kgm2`]: Number(found.std.toPrecision(2)) }
      take(made)
      says.textContent = `${axis.value} is ${number(found.value, 4)} ± ${number(found.std, 2)} kg m²`
    } catch (error) {
      says.className = 'remark bad'
      says.textContent = sentence(error)
    }
  }
  return h('details', {}, h('summary', {}, 'Work one out from swings'),
    h('div', { class: 'grid' }, field('About which axis', axis), field('How it hung', way), lengthField, spacingField,
      field('Whole swings timed', count), field('Seconds for them, each time', times, 'Time them three times')),
    h('button', { type: 'button', click: work }, 'Work it out'), says)
}
