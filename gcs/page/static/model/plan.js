// The next flight: which manoeuvres, and what error bars they will give, beside those that this flight has reached.

import { get, hand, post, sentence } from '../shared/api.js'
import { field, h, listing, remark, select, table, there } from '../shared/dom.js'
import { number } from '../shared/format.js'
import { nothingYet } from '../flight/jobs.js'
import { modelTitle } from './modeltitle.js'

const WAYS = [['', 'multisine on all surfaces (the most in the shortest time)'],
  ['elevator-3211,aileron-3211,rudder-3211', '3-2-1-1 on each surface'],
  ['elevator-doublet,aileron-doublet,rudder-doublet', 'doublets on each surface'],
  ['elevator-multisine', 'multisine on the elevator'],
  ['aileron-multisine,rudder-multisine', 'multisines on ailerons and rudder']]

/**
 * The tab of the next flight. result: null where none was planned.
 * @param {HTMLElement} page
 * @param {DesignResult | null} result
 * @param {FlightSummary} summary
 * @param {AbortSignal} signal
 */
export async function plan(page, result, summary, signal) {
  /** @type {ModelItem[]} */
  const models = await get('/api/models', signal)
  page.append(h('p', {},
    'A plan is flown in the simulator with a model that is known so far; what the sensors would measure says how well '
      + 'each coefficient would then be known.'))
  page.append(models.length ? form(summary, models, signal)
    : remark('note', h('p', {}, 'A plan needs a model to begin with: identify this flight first.')))
  if (!result) {
    if (summary.jobs.some(job => job.kind === 'design'))
      page.append(nothingYet(summary, 'design',
        { failed: 'The last plan failed', missing: 'The plan is being made.', start: 'See its progress' }))
    return
  }
  const own = await reached(summary, signal)
  page.append(...there(h('section', { class: 'card' }, h('h2', {}, `Flight card: ${result.vehicle}`),
    h('p', {}, `${number(result.duration_s)} s, `
      + `${result.gusts ? `turbulence of ${number(result.gusts)} m/s` : 'calm air'}, with model ${result.model}.`),
    h('p', {}, `Level and trimmed${Number.isFinite(result.trim?.V) ? ` at ${number(result.trim?.V)} m/s` : ''}, in `
      + `calm air, with height to lose; let the aircraft settle before each part and touch nothing meanwhile. `
      + 'The script below moves the surfaces itself, at a switch. By hand doublets and 3-2-1-1 can be flown; a '
      + 'multisine cannot.'),
    listing(result.plan.segments.map(step)), h('p', {}, `Expect ${reach(result)}.`)),
  result.warnings.length && remark('note', listing(result.warnings)),
  h('p', { class: 'row' }, h('button', { click: () => window.print() }, 'Print the card'),
    Object.entries(result.files).map(([name, text]) =>
      h('button', { click: () => hand(new Blob([text]), name) }, FILES[name] ?? name))),
  result.files['plan.lua'] ? ontoBoard(summary) : '',
  h('h2', {}, 'What to expect'),
  h('p', { class: 'hint' }, result.method === 'map'
    ? 'The plan was flown in the simulator and identified as this flight was: with what the vehicle file does not say '
      + 'of sensors and servos counted in.'
    : 'The smallest standard errors that sensors as the vehicle file says them allow (Cramér–Rao).'),
  table('Standard errors to expect', ['Coefficient', 'Model so far', 'Expected ±', 'Per cent', 'This flight ±'],
    result.coefficients.map(one => [
      h('code', {}, one.name), number(one.value, 4),
      `${number(one.std, 2)}${own[one.name] && one.std > 1.1 * own[one.name] ? ' (wider than this flight’s)' : ''}`,
      one.percent === null ? '' : `${number(one.percent, 2)} %`, number(own[one.name], 2)])),
  result.refused.length && table('What it cannot identify', ['Coefficient', 'Why', 'Fly instead'],
    result.refused.map(one => [h('code', {}, one.name), one.reason, one.manoeuvre ?? '']))))
}

/** Writes the plan's script to the vehicle's card, and says what to do next. @param {FlightSummary} summary */
function ontoBoard(summary) {
  const says = h('p', { role: 'status' })
  const button = h('button', { click: async () => {
    button.disabled = true
    says.className = ''
    says.textContent = 'The vehicle takes the script …'
    try {
      const { path, bytes } = await post(`/api/flights/${encodeURIComponent(summary.id)}/design/upload`, {})
      says.textContent = `${bytes.toLocaleString('en')} bytes are on its card as ${path}, checked by the board `
        + `itself. Set SCR_ENABLE to 1 and RCn_OPTION of a switch to 300, start the board anew, and flip the switch `
        + `at a safe height.`
    } catch (error) {
      says.className = 'remark bad'
      says.textContent = sentence(error)
    } finally {
      button.disabled = false
    }
  } }, 'Write the script to the vehicle (ArduPilot)')
  return h('div', {}, h('p', { class: 'row' }, button), says)
}

/** @type {Record<string, string>} */
const FILES = { 'plan.json': 'Plan for sim-vehicle (JSON)', 'plan.lua': 'Script for ArduPilot Plane (Lua)' }

/**
 * Standard errors of this flight's newest model, by coefficient.
 * @param {FlightSummary} summary
 * @param {AbortSignal} signal
 * @returns {Promise<Record<string, number>>}
 */
async function reached(summary, signal) {
  /** @type {ModelItem[]} */
  const models = await get('/api/models', signal)
  const newest = models.find(model => model.flight_id === summary.id && model.kind === 'identify')
  if (!newest) return {}
  /** @type {Model} */
  const { coefficients } = await get(`/api/models/${newest.id}`, signal)
  return Object.fromEntries(Object.entries(coefficients)
    .map(([name, entry]) => [name, entry.statistical_std ?? entry.std]))
}

/** @param {number} value */
const degrees = value => `${number(value * 180 / Math.PI, 2)}°`

/** @param {Segment} segment */
function step(segment) {
  const peaks = Object.entries(segment.amplitudes ?? { '': segment.amplitude }).map(([axis, peak]) =>
    `${axis} ${degrees(peak ?? 0)}`.trim()).join(', ')
  return segment.manoeuvre === 'cruise' ? `${number(segment.duration)} s straight and level`
    : `${segment.manoeuvre}: ${number(segment.duration)} s, `
      + `${peaks}${segment.width ? `, shortest pulse ${number(segment.width)} s` : ''}`
}

/** @param {DesignResult} result */
function reach({ excursions }) {
  /** @param {string} name @param {string} words @param {(value: number) => string} shown */
  const between = (name, words, shown) =>
    excursions[name] && `${words} ${shown(excursions[name][0])} to ${shown(excursions[name][1])}`
  return [between('V', 'airspeed', value => `${number(value)} m/s`), between('alpha', 'angle of attack', degrees),
    between('phi', 'bank', degrees), between('theta', 'pitch', degrees)].filter(Boolean).join(', ')
}

/** @param {FlightSummary} summary @param {ModelItem[]} models @param {AbortSignal} signal */
function form(summary, models, signal) {
  const model = select(models.map(one => [one.id, modelTitle(one, true)]),
    models.find(one => one.flight_id === summary.id)?.id ?? models[0].id)
  const way = select(WAYS, '')
  const [duration, gusts, alpha, bank] = [20, 0, '', ''].map(value =>
    h('input', { type: 'number', step: 'any', min: 0, value }))
  const says = h('p', { role: 'status' })
  return h('form', { class: 'panel', submit: async event => {
    event.preventDefault()
    says.className = ''
    says.textContent = 'Sent …'
    const limits = Object.fromEntries(/** @type {[string, HTMLInputElement][]} */ ([['alpha', alpha], ['bank', bank]])
      .filter(([, input]) => input.value)
      .map(([name, input]) => [name, Number(input.value)]))
    try {
      const job = await post(`/api/flights/${encodeURIComponent(summary.id)}/jobs`,
        { kind: 'design', model: model.value, limits,
          manoeuvres: way.value.split(',').filter(Boolean), duration: Number(duration.value),
          gusts: Number(gusts.value) })
      if (await over(job.id, signal, text => { says.textContent = text })) location.reload()
    } catch (error) {
      says.className = 'remark bad'
      says.textContent = sentence(error)
    }
  } }, h('h2', {}, 'Plan the next flight'),
  h('div', { class: 'grid' }, field('Model so far', model), field('Manoeuvres', way),
    field('Seconds', duration), field('Turbulence to expect, m/s', gusts),
    field('Angle of attack at most, ° from trim', alpha, 'May stay empty'),
    field('Bank at most, °', bank, 'May stay empty')), h('button', { class: 'main' }, 'Plan it'), says)
}

/**
 * Wait until a job is done, and whether somebody still waits here; throws what it failed with.
 * @param {string} id
 * @param {AbortSignal} signal
 * @param {(text: string) => void} say
 */
async function over(id, signal, say) {
  while (!signal.aborted) {
    /** @type {Job} */
    const job = await get(`/api/jobs/${id}`)
    if (job.state === 'done') return !signal.aborted
    if (job.state !== 'queued' && job.state !== 'running') throw new Error(job.error ?? `the plan was ${job.state}`)
    say(`${Math.round(100 * job.progress)} %: ${job.log.at(-1) ?? 'waiting'}`)
    await new Promise(resolve => setTimeout(resolve, 700))
  }
  return false
}
