// The result of an identification: validation, coefficients, sensors, residuals.

import { get, getIfThere } from '../shared/api.js'
import { announce } from '../shared/announce.js'
import { field, h, listing, remark, select, table, there } from '../shared/dom.js'
import { coefficientTable, refusedTable, sensorTable } from './estimates.js'
import { chance, estimate, NONE, number, plusMinus, utc } from '../shared/format.js'
import { nothingYet } from '../flight/jobs.js'
import { download, opened } from '../shared/links.js'
import { gaps, legendAbove, level, line, plot, shown, source, BLUE, RED } from '../shared/plots.js'

/** @type {Record<keyof Score, string>} */
const SCORES = {
  tic: 'TIC', r2: 'R²', residual_mean: 'Residual mean', residual_std: 'Residual σ', rms_over_noise: 'rms / noise',
  largest_over_noise: 'Largest / noise', gaussian_p: 'Gaussian p',
}
const FIGURES = /** @type {(keyof Score)[]} */ (Object.keys(SCORES))
const BREAK = 5

/**
 * The tab of a flight's model. result: null where no identification has ended.
 * @param {HTMLElement} page
 * @param {IdentificationResult | null} result
 * @param {FlightSummary} summary
 * @param {AbortSignal} signal
 */
export function identification(page, result, summary, signal) {
  const id = encodeURIComponent(summary.id)
  if (!result) {
    page.append(nothingYet(summary, 'identify', {
      failed: 'The last identification failed', missing: 'No model has been identified from this flight.',
      start: 'Start an identification',
    }))
    return
  }
  const found = result.validation
  page.append(
    quality(result), verdict(result), ...there(
      result.warnings.length && remark('note', h('h2', {}, 'Warnings'), listing(result.warnings))),
    h('p', { class: 'row' }, opened(`/api/flights/${id}/report?of=identification`, 'Report to read and print'),
      download(`/api/flights/${id}/identification`, `${summary.id}-identification.json`, 'Result (JSON)'),
      h('span', { id: 'model-download' }), h('a', { class: 'button', href: `#/compare?a=${id}` }, 'Compare')),
    h('h2', {}, 'Coefficients'), ...there(coefficientTable(result.model), refusedTable(result.refused)),
    h('div', { id: 'planned' }), h('h2', {}, 'Sensors'), compatible(result), ...there(
      sensorTable(result.sensor_errors), verdicts(result), compatibility(result)),
    h('h2', {}, 'Validation'),
    ...there(found ? table(`Figures of merit on ${found.flights.join(', ')}`,
      ['Output', ...Object.values(SCORES)], Object.entries(found.outputs).map(([name, entry]) =>
        [h('code', {}, name), ...FIGURES.map(key =>
          key === 'gaussian_p' ? chance(entry[key], 3) : number(entry[key]))])) : null),
    h('h2', {}, 'Measured and predicted'), residuals(result.series, signal),
    h('h2', {}, 'Modes'), ...there(modes(result.modes), derivatives(result.dimensional)),
    h('h2', {}, 'How it was made'), ...there(segments(result)),
  )
  modelLink(/** @type {Element} */ (page.querySelector('#model-download')), summary.id, 'identify', signal)
  planned(/** @type {Element} */ (page.querySelector('#planned')), id, signal)
    .catch(error => signal.aborted || announce(error.message, true))
}

/**
 * Put what the plan before this flight promised beside what it gave, where there was one.
 * @param {Element} place
 * @param {string} id
 * @param {AbortSignal} signal
 */
async function planned(place, id, signal) {
  /** @type {Planned | null} */
  const plan = await getIfThere(`/api/flights/${id}/planned`, signal)
  if (!plan) return
  /** @param {Planned['coefficients'][number]} coefficient */
  const times = ({ expected_std: expected, reached_std: reached }) =>
    expected && reached && expected > 0 && reached > 0 ? `${number(reached / expected, 2)} times` : NONE
  place.append(h('details', {}, h('summary', {}, 'Planned and reached'),
    h('p', {}, 'Planned on ', utc(plan.made), ' behind flight ',
      h('a', { href: `#/flights/${encodeURIComponent(plan.flight)}/plan` }, plan.flight),
      `, for ${plan.gusts ? `turbulence of ${number(plan.gusts)} m/s` : 'calm air'}. More than planned: rougher air, `
        + `smaller deflections, or sensors with more noise than the vehicle file says.`),
    table('Standard errors', ['Coefficient', 'Planned ±', 'Reached ±', 'Reached over planned'],
      plan.coefficients.map(one => [
        h('code', {}, one.name), number(one.expected_std, 2),
        one.reached_std === null ? 'not identified' : number(one.reached_std, 2), times(one)]))))
}

/**
 * Put the download of the newest model of that flight and kind in a place.
 * @param {Element} place
 * @param {string} flight
 * @param {ModelItem['kind']} kind
 * @param {AbortSignal} signal
 */
export async function modelLink(place, flight, kind, signal) {
  /** @type {ModelItem[]} */
  const models = await get('/api/models', signal)
  const mine = models.find(model => model.flight_id === flight && model.kind === kind)
  if (!mine) return
  const model = `/api/models/${encodeURIComponent(mine.id)}`
  place.append(download(model, `${flight}-model.json`, 'Model (JSON)'),
    download(`${model}/export?to=jsbsim`, `${flight}-jsbsim.zip`, 'Aircraft for JSBSim'),
    download(`${model}/export?to=gazebo`, `${flight}-gazebo.zip`, 'Aircraft for Gazebo'),
    download(`${model}/export?to=daveml`, `${flight}-model.dml`, 'Model (DAVE-ML)'),
    download(`${model}/export?to=csv`, `${flight}-model.zip`, 'Table (CSV)'),
    download(`${model}/export?to=latex`, `${flight}-model.tex`, 'Table (LaTeX)'))
}

/** @type {Record<string, [string, string]>} */
const QUALITY = { good: ['good', 'The flight is good for identification.'],
  care: ['note', 'The flight is usable with care, because:'], poor: ['bad', 'The flight is too poor, because:'] }

/** What the flight is worth, and why. Nothing in results that do not say. @param {Judged} result */
export function quality({ quality: found, senders }) {
  if (!found) return ''
  const [kind, words] = QUALITY[found.verdict] ?? ['note', found.verdict]
  const flown = Object.entries(senders ?? {}).map(([flight, one]) => `${flight}: ${one.type}, ${one.autopilot}.`)
  return remark(kind, h('p', { class: 'verdict' }, words), ...there(flown.length ? h('p', {}, flown.join(' ')) : null),
    ...there(found.reasons.length ? listing(found.reasons) : null))
}

/** @param {IdentificationResult} result */
function verdict({ validation }) {
  if (!validation) {
    return remark('note', h('p', {},
      'Not judged on another flight: start the identification again and name one to validate on.'))
  }
  const good = validation.outliers ? 'Acceptable by TIC, not down to the noise' : 'Acceptable'
  return remark(!validation.acceptable ? 'bad' : validation.outliers ? 'note' : 'good', h('p', {},
    `${validation.acceptable ? good : 'Not acceptable, fly again'}: ${validation.reason}.`),
  ...there(validation.outliers ? h('p', {}, `${validation.outliers}.`) : null))
}

/** @param {IdentificationResult} result */
function compatible({ compatibility: found }) {
  if (found?.compatible === null) {
    return remark('note', h('p', {}, 'Whether the sensors agree on one motion is not known: the check did not settle.'))
  }
  if (typeof found?.compatible !== 'boolean') return ''
  return remark(found.compatible ? 'good' : 'bad', h('p', {}, found.compatible
    ? 'After correction the sensors agree on one motion.' : 'The sensors do not agree on one motion.'))
}

/** @param {IdentificationResult} result */
const verdicts = result => table('Verdict on each sensor', ['Sensor', 'In words', 'Status'],
  (result.compatibility?.verdicts ?? []).map(one => [one.signal, one.verdict, one.status]))

/** @param {IdentificationResult} result */
function compatibility({ compatibility: found }) {
  const [before, after] = [found?.before ?? {}, found?.after ?? {}]
  return table('Data compatibility before and after correction (SI units, rad)',
    ['Sensor', 'rms before', 'rms after', 'TIC before', 'TIC after'],
    Object.keys({ ...before, ...after }).map(name => [name, number(before[name]?.rms), number(after[name]?.rms),
      number(before[name]?.tic), number(after[name]?.tic)]))
}

/** @param {IdentificationResult['modes']} found */
function modes(found) {
  if (!Array.isArray(found)) return found ? h('p', {}, `No modes: ${found.refused}.`) : null
  /** @param {Estimate | null} entry */
  const cell = entry => entry ? `${estimate(entry.value, entry.std)} ± ${number(entry.std, 2)}` : NONE
  return table('Modes about the mean airspeed (a negative time constant grows)',
    ['Mode', 'Frequency, Hz', 'Damping ratio', 'Time constant, s'],
    found.map(mode => [mode.name, cell(mode.frequency_hz), cell(mode.damping_ratio), cell(mode.time_constant_s)]))
}

/** @param {IdentificationResult['dimensional']} found */
function derivatives(found) {
  const entries = Object.entries(found ?? {})
  if (!entries.length) return null
  return table('Dimensional derivatives about the mean airspeed, per rad: they need neither mass nor inertia',
    ['Derivative', 'Value ± 1 σ', 'Unit'],
    entries.map(([name, entry]) => [h('code', {}, name), plusMinus(entry), entry.unit]))
}

/** @param {IdentificationResult} result */
const segments = result => table('Parts of the flights that were used', ['Flight', 'From, s', 'To, s', 'Kind', 'Why'],
  result.segments.map(one => [one.flight, number(one.start), number(one.end), one.kind ?? '', one.reason ?? '']))

/** @param {ResidualSeries | undefined} series @param {AbortSignal} signal */
function residuals(series, signal) {
  if (!series?.flights?.length) {
    return remark('note', h('p', {}, series?.refused ? `No curves: ${series.refused}.`
      : 'The result holds no curves; identify the flight again with this version to have them.'))
  }
  const names = Object.keys(series.residuals ?? series.flights[0].axes)
  const place = h('div', { class: 'plots' })
  /** @param {string} name */
  const draw = async name => place.replaceChildren(...await curves(series, name, signal))
  draw(names[0])
  return h('div', {}, h('p', {}, series.use === 'validation' ? 'On flights that the model was not fitted to.'
    : 'On the flights that the model was fitted to.'),
  field('Coefficient', select(names.map(name => [name, name]), names[0], draw)), place)
}

/** @param {ResidualSeries} series @param {string} name @param {AbortSignal} signal */
async function curves(series, name, signal) {
  const made = []
  for (const { flight, axes } of (series.flights ?? []).filter(one => one.axes[name])) {
    const entry = broken(axes[name])
    const data = await source(entry)
    const left = await source({ time_s: entry.time_s,
      residual: entry.measured.map((v, i) => v === null ? null : v - (entry.predicted[i] ?? 0)) })
    const both = await plot({ x: 'time, s', y: name, height: 260 })
    line(both, data, 'time_s', 'measured', 0, 'measured')
    line(both, data, 'time_s', 'predicted', 1, 'predicted')
    legendAbove(both)
    made.push(await shown(both, `Flight ${flight}: ${name} as measured and as the model predicts it`, signal))
    const rest = await plot({ x: 'time, s', y: `residual of ${name}`, height: 180 })
    line(rest, left, 'time_s', 'residual', 0)
    await level(rest, 0, 'solid')
    made.push(await shown(rest, `Flight ${flight}: residual of ${name}, measured minus predicted`, signal))
  }
  const statistics = series.residuals?.[name]
  if (statistics) made.push(await autocorrelation(statistics, name, signal), await histogram(statistics, name, signal))
  return made
}

/**
 * A series with a gap wherever its stretches of time do not join.
 * @param {Curve} entry
 * @returns {Record<keyof Curve, (number | null)[]>}
 */
function broken(entry) {
  const steps = entry.time_s.slice(1).map((time, i) => time - entry.time_s[i])
  const usual = [...steps].sort((a, b) => a - b)[Math.floor(steps.length / 2)] ?? 0
  const keys = /** @type {const} */ (['time_s', 'measured', 'predicted'])
  /** @type {Record<keyof Curve, (number | null)[]>} */
  const out = { time_s: [], measured: [], predicted: [] }
  entry.time_s.forEach((time, i) => {
    if (i && steps[i - 1] > BREAK * usual) for (const key of keys) out[key].push(null)
    for (const key of keys) out[key].push(entry[key][i])
  })
  return out
}

/** @param {Residual} statistics @param {string} name @param {AbortSignal} signal */
async function autocorrelation({ autocorrelation: rho, lag_step_s: step, limit }, name, signal) {
  const figure = await plot({ x: 'lag, s', y: 'autocorrelation', height: 180 })
  const outside = rho.slice(1).filter(value => Math.abs(value) > limit).length
  const data = await source({ lag: rho.map((_, i) => i * step), rho, zero: rho.map(() => 0) })
  figure.segment({ field: 'lag' }, { field: 'zero' }, { field: 'lag' }, { field: 'rho' },
    { source: data, line_color: BLUE, line_width: 3 })
  await level(figure, limit)
  await level(figure, -limit)
  return shown(figure, `Autocorrelation of the residual of ${name}: ${outside} of ${rho.length - 1} lags outside `
    + 'the 95 % limits of a white series (dashed)', signal)
}

/** @param {Residual} statistics @param {string} name @param {AbortSignal} signal */
async function histogram({ histogram: { low, high, counts }, mean, std }, name, signal) {
  const figure = await plot({ x: `residual of ${name}`, y: 'density', height: 180 })
  const [width, total] = [(high - low) / counts.length, counts.reduce((sum, n) => sum + n, 0)]
  const data = await source({ middle: counts.map((_, i) => low + (i + 0.5) * width),
    top: counts.map(n => n / total / width) })
  figure.vbar({ x: { field: 'middle' }, top: { field: 'top' }, width: 0.9 * width, source: data,
    fill_color: BLUE, line_color: null })
  const x = Array.from({ length: 101 }, (_, i) => low + (high - low) * i / 100)
  const normal = await source(gaps({ x,
    y: x.map(v => Math.exp(-0.5 * ((v - mean) / std) ** 2) / std / Math.sqrt(2 * Math.PI)) }))
  figure.line({ field: 'x' }, { field: 'y' }, { source: normal, line_color: RED, line_width: 3 })
  return shown(figure, `Distribution of the residual of ${name}; line: the normal density of its mean ${number(mean)} `
    + `and standard deviation ${number(std)}`, signal)
}
