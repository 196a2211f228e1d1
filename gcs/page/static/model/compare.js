// Two models side by side with the difference in standard errors, and a signal of two flights over each other.

import { get, sentence } from '../shared/api.js'
import { bars, estimated } from './estimates.js'
import { field, h, remark, select, table, there } from '../shared/dom.js'
import { findFlights, flightSearch, flightTitle } from '../flight/flightchoice.js'
import { NONE, number, plusMinus, shownUnit, signalName } from '../shared/format.js'
import { modelTitle } from './modeltitle.js'
import { legendAbove, line, plot, shown, source } from '../shared/plots.js'
import { keepQuery } from '../shared/router.js'

const [POINTS, FAR] = [1000, 3]

/**
 * The view that compares; the address keeps the models (ma, mb) and the flights (fa, fb), `a` names a flight.
 * @param {HTMLElement} page
 * @param {string[]} parts
 * @param {URLSearchParams} query
 * @param {AbortSignal} signal
 */
export async function compare(page, parts, query, signal) {
  /** @type {[ModelItem[], FlightPage]} */
  const [models, found] = await Promise.all([get('/api/models', signal), findFlights({}, signal)])
  await addNamed(found.flights, query, signal)
  page.append(h('h1', {}, 'Compare'))
  modelSection(page, models, query, signal)
  signalSection(page, found, query, signal)
}

/**
 * The flights that the address names, which may be older than those found.
 * @param {Flight[]} flights
 * @param {URLSearchParams} query
 * @param {AbortSignal} signal
 */
async function addNamed(flights, query, signal) {
  const named = ['a', 'fa', 'fb'].map(key => query.get(key) ?? '')
    .filter(id => id && !flights.some(one => one.id === id))
  for (const id of new Set(named)) flights.push(...(await findFlights({ search: id }, signal)).flights.filter(one =>
    one.id === id))
}

/** @param {Flight[]} flights */
const comparable = flights => flights.filter(one => one.state !== 'recording' && !one.recording_deleted)

/**
 * @param {URLSearchParams} query
 * @param {string} key
 * @param {string} fallback
 * @param {Choice[]} choices
 * @param {() => void} change
 */
function choice(query, key, fallback, choices, change) {
  const asked = query.get(key)
  const chosen = asked !== null && choices.some(([value]) => value === asked) ? asked : fallback
  query.set(key, chosen)
  return select(choices, chosen, value => {
    query.set(key, value)
    keepQuery(query)
    change()
  })
}

/** @param {HTMLElement} page @param {ModelItem[]} models @param {URLSearchParams} query @param {AbortSignal} signal */
function modelSection(page, models, query, signal) {
  page.append(h('h2', {}, 'Models'))
  if (models.length < 2) {
    page.append(remark('note',
      h('p', {}, `There ${models.length ? 'is one model' : 'is no model yet'}; two are needed. `
        + 'Open a flight and start an identification.'),
        h('p', {}, h('a', { class: 'button', href: '#/flights' }, 'To the flights'))))
    return
  }
  const place = h('div', {})
  const choices = models.map(model => [model.id, modelTitle(model)])
  const draw = async () => {
    const ids = [query.get('ma'), query.get('mb')]
    try {
      const two = await Promise.all(ids.map(id => get(`/api/models/${id}`, signal)))
      place.replaceChildren(...coefficients(two))
    } catch (error) {
      place.replaceChildren(remark('bad', sentence(error)))
    }
  }
  const mine = models.find(model => model.flight_id === query.get('a')) ?? models[0]
  const other = models.find(model => model.flight_id !== mine.flight_id)
    ?? models.find(model => model !== mine) ?? mine
  page.append(h('div', { class: 'pair' },
    field('First model', choice(query, 'ma', mine.id, choices, draw)),
    field('Second model', choice(query, 'mb', other.id, choices, draw))), place)
  draw()
}

/**
 * The difference of two estimates in its standard error; null where either has none.
 * @param {Coefficient} [a]
 * @param {Coefficient} [b]
 */
export function difference(a, b) {
  // What one aircraft's flights share moves none of their differences.
  const own = (/** @type {Coefficient | undefined} */ entry) => entry?.statistical_std ?? entry?.std ?? NaN
  const std = Math.hypot(own(a), own(b))
  return a && b && std > 0 ? (b.value - a.value) / std : null
}

/** @param {Model[]} models */
function coefficients(models) {
  const [a, b] = models.map(model => Object.fromEntries(estimated(model)))
  const all = Object.keys({ ...a, ...b })
  const both = all.filter(name => difference(a[name], b[name]) !== null)
  const far = both.filter(name => Math.abs(difference(a[name], b[name]) ?? 0) > FAR)
  const rows = all.map(name => {
    const there = [a[name], b[name]].filter(Boolean)
    const z = difference(a[name], b[name])
    const apart = z === null ? NONE : number(z, 2)
    return [h('code', {}, name), a[name] ? plusMinus(a[name]) : NONE, b[name] ? plusMinus(b[name]) : NONE,
      there.length === 2 ? bars(there, false) : '', Math.abs(z ?? 0) > FAR ? h('strong', {}, `${apart} far`) : apart]
  })
  return there(
    h('p', {}, far.length
      ? `${far.length} of the ${both.length} that both know differ by more than ${FAR} standard errors: `
        + `${far.join(', ')}.`
      : `None of the ${both.length} that both know differs by more than ${FAR} standard errors.`),
    h('p', { class: 'hint' }, 'Standard errors of the difference, the flights being independent. Drawing: first above, '
      + 'second below, 95 % intervals.'),
    table('Coefficients of both models', ['Coefficient', 'First', 'Second', '95 % intervals', 'Difference, σ'], rows),
  )
}

/** @param {HTMLElement} page @param {FlightPage} found @param {URLSearchParams} query @param {AbortSignal} signal */
function signalSection(page, found, query, signal) {
  const flights = comparable(found.flights)
  page.append(h('h2', {}, 'A signal of two flights'))
  if (flights.length < 2) {
    page.append(remark('note', h('p', {}, 'Two recorded flights are needed.')))
    return
  }
  const place = h('div', { class: 'plots' })
  const picker = h('div', {})
  const choices = flights.map(flight => [flight.id, flightTitle(flight)])
  const chosen = () => [query.get('fa'), query.get('fb')].map(id =>
    flights.find(flight => flight.id === id) ?? flights[0])
  const draw = async () => {
    try {
      place.replaceChildren(await overlay(chosen(), query.get('s') ?? '', signal))
    } catch (error) {
      place.replaceChildren(remark('bad', sentence(error)))
    }
  }
  const names = async () => {
    /** @type {FlightSummary[]} */
    const lists = await Promise.all(chosen().map(flight =>
      get(`/api/flights/${encodeURIComponent(flight.id)}`, signal)))
    const common = lists[0].signals.filter(name => lists[1].signals.includes(name))
    if (!common.length) {
      picker.replaceChildren(remark('note', h('p', {}, 'These flights have no signal in common; their pages say why.')))
      return place.replaceChildren()
    }
    const first = common.includes('alpha') ? 'alpha' : common[0]
    picker.replaceChildren(field('Signal',
      choice(query, 's', first, common.map(name => [name, signalName(name)]), draw)))
    return draw()
  }
  const mine = flights.find(flight => flight.id === query.get('a')) ?? flights[0]
  const other = flights.find(flight => flight !== mine) ?? mine
  const selects = [choice(query, 'fa', mine.id, choices, names), choice(query, 'fb', other.id, choices, names)]
  /** What is found stands in both lists beside what is chosen in each. @param {FlightPage} more */
  const offer = more => {
    const matching = comparable(more.flights)
    for (const one of matching) if (!flights.some(known => known.id === one.id)) flights.push(one)
    selects.forEach((list, index) => {
      const now = chosen()[index]
      const offered = [now, ...matching.filter(one => one.id !== now.id)]
      list.replaceChildren(...offered.map(one =>
        h('option', { value: one.id, selected: one === now }, flightTitle(one))))
    })
  }
  page.append(...(found.next ? [flightSearch(offer, signal)] : []), h('div', { class: 'pair' },
    field('First flight', selects[0]), field('Second flight', selects[1])), picker, place)
  names().catch(error => picker.replaceChildren(remark('bad', error.message)))
}

/** @param {Flight[]} flights @param {string} name @param {AbortSignal} signal */
async function overlay(flights, name, signal) {
  /** @type {{ signals: Record<string, Series> }[]} */
  const answers = await Promise.all(flights.map(flight =>
    get(`/api/flights/${encodeURIComponent(flight.id)}/signals?names=${encodeURIComponent(name)}&points=${POINTS}`,
      signal)))
  const [unit, factor] = shownUnit(answers[0].signals[name].unit)
  const figure = await plot({ x: 'time from the start of each flight, s', y: unit, height: 320 })
  for (const [index, answer] of answers.entries()) {
    const series = answer.signals[name]
    const data = await source({ x: series.time, y: series.value.map(v => v === null ? null : v * factor) })
    line(figure, data, 'x', 'y', index, flightTitle(flights[index]))
  }
  legendAbove(figure)
  return shown(figure, `${signalName(name)} of ${flights.map(flightTitle).join(' and ')}`, signal)
}
