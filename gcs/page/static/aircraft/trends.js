// Coefficients of an aircraft over its flights, with error bars and whether one has changed.

import { get } from '../shared/api.js'
import { field, h, remark, select } from '../shared/dom.js'
import { estimate, number, plusMinus, utc } from '../shared/format.js'
import { BLUE, level, plot, RED, shown, source } from '../shared/plots.js'

// Flights of one value differ as much less often than this: something is another in one of them, whatever came later.
const APART = 0.001
const FIRST = ['CL_alpha', 'Cm_alpha', 'Cm_de', 'Cl_da', 'Cn_dr']

/**
 * The section of trends; an element that says so where there are too few flights.
 * @param {string} id
 * @param {AbortSignal} signal
 */
export async function trends(id, signal) {
  /** @type {Trend[]} */
  const found = await get(`/api/vehicles/${encodeURIComponent(id)}/trends`, signal)
  const section = h('section', {}, h('h2', {}, 'Over its flights'))
  const known = found.filter(one => one.estimates.length > 1)
  if (!known.length) {
    section.append(h('p', {},
      found.length ? 'One flight was identified with it; from the second one on its coefficients are compared here.'
        : 'No flight was identified with it yet.'))
    return section
  }
  const changed = known.filter(one => one.change)
  const apart = known.filter(one => !one.change && one.constant_p < APART)
  if (apart.length) {
    section.append(remark('note',
      h('p', {}, h('strong', {}, 'Flights differ beyond their intervals, without one lasting change: '),
        apart.map(({ name }) => name).join(', '), '. Look at the result of the flight that lies apart.')))
  }
  if (changed.length)
    section.append(remark('bad', h('p', {}, h('strong', {}, 'Changed: '), changed.map(({ name }) => name).join(', '))))
  else if (!apart.length) {
    section.append(remark('good',
      h('p', {}, `No coefficient has changed beyond what chance does, over `
        + `${Math.max(...known.map(one => one.estimates.length))} flights.`)))
  }
  const place = h('div', { class: 'plots' })
  /** @param {string} name */
  const draw = async name =>
    place.replaceChildren(await drawn(known.find(one => one.name === name) ?? known[0], signal))
  const first = changed[0]?.name ?? apart[0]?.name ?? FIRST.find(name => known.some(one => one.name === name))
    ?? known[0].name
  section.append(field('Coefficient', select(known.map(({ name }) => [name, name]), first, draw)), place)
  await draw(first)
  return section
}

/** @param {Trend} trend @param {AbortSignal} signal */
async function drawn({ name, estimates, mean, std, constant_p, change }, signal) {
  const titles = estimates.map((one, index) => one.title || utc(one.start) || String(index + 1))
  const figure = await plot({ x: 'flight, oldest first', y: name, height: 260, counted: true })
  const at = estimates.map((_, index) => index + 1)
  const data = await source({ at, value: estimates.map(one => one.value),
    low: estimates.map(one => one.value - 1.96 * one.std), high: estimates.map(one => one.value + 1.96 * one.std) })
  figure.segment({ field: 'at' }, { field: 'low' }, { field: 'at' }, { field: 'high' },
    { source: data, line_color: BLUE, line_width: 3 })
  figure.scatter({ field: 'at' }, { field: 'value' }, { source: data, size: 9, line_color: null, fill_color: BLUE })
  if (change) {
    const behind = estimates.findIndex(one => one.flight === change.flight) + 0.5
    const steps = await source({ x0: [0.5, behind], x1: [behind, estimates.length + 0.5],
      y: [change.before, change.after] })
    figure.segment({ field: 'x0' }, { field: 'y' }, { field: 'x1' }, { field: 'y' },
      { source: steps, line_color: RED, line_width: 3 })
  } else {
    await level(figure, mean)
  }
  return shown(figure, words({ name, estimates, mean, std, constant_p, change }, titles), signal)
}

/** @param {Trend} trend @param {string[]} titles */
function words({ name, estimates, mean, std, constant_p, change }, titles) {
  const all = `${name} of ${estimates.length} flights, 95 % intervals; weighted mean ${plusMinus({ value: mean, std })}`
  if (!change && constant_p < APART)
    return `${all}. The flights differ beyond their intervals (p = ${number(constant_p, 2)}), without one lasting `
      + `change.`
  if (!change)
    return `${all}. No change beyond chance (flights of one value differ as much with p = ${number(constant_p, 2)}).`
  const [before, after] = [[change.before, change.before_std],
    [change.after, change.after_std]].map(([value, error]) => `${estimate(value, error)} ± ${estimate(error, error)}`)
  const since = titles[estimates.findIndex(one => one.flight === change.flight)]
  return `${all}. It changed from ${before} to ${after} with flight ${since} (p = ${number(change.p, 2)}).`
}
