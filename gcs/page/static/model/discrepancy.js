// The result of a discrepancy analysis: the verdict, what is missing, and how far the gap shrinks.

import { field, h, listing, remark, select, table, there } from '../shared/dom.js'
import { chance, NONE, number, percent, plusMinus, probability, shownUnit, signalName } from '../shared/format.js'
import { modelLink, quality } from './identification.js'
import { nothingYet } from '../flight/jobs.js'
import { download, opened } from '../shared/links.js'
import { band, BLACK, bokeh, COLOURS, legendAbove, level, line, plot, shown, source } from '../shared/plots.js'

/** @type {Record<string, [string, string]>} */
const VERDICTS = {
  none: ['good', 'No significant gap: the model explains the flight.'],
  parameter_error: ['note', 'The structure is right; its coefficients were off.'],
  missing_effect: ['bad', 'The model lacks an effect.'],
  unexplained: ['bad', 'There is a real gap that no effect of the catalogue closes.'],
}
/** @type {Record<string, string>} */
const STAGES = { given: 'as given', before: 'fitted again', after: 'effect added' }
// Colours of the stages, the same in every plot.
const ORDER = ['unused', 'before', 'after', 'given']
/** @type {Record<string, string>} */
const USES = { estimation: 'Flights used for the fit', validation: 'Flights not used for the fit' }
/** @type {Record<string, string>} */
const UNITS = {
  V: 'm/s', alpha: 'rad', beta: 'rad', p: 'rad/s', q: 'rad/s', r: 'rad/s', phi: 'rad', theta: 'rad',
  ax: 'm/s^2', ay: 'm/s^2', az: 'm/s^2',
}
// Units of the variables over which a residual is drawn, which have those of the outputs or none.
/** @type {Record<string, string>} */
const VARIABLES = { ...UNITS, de: 'rad', da: 'rad', dr: 'rad', thrust: 'N', time: 's', height: 'm' }

/**
 * The tab of a flight's discrepancy. result: null where no analysis has ended.
 * @param {HTMLElement} page
 * @param {DiscrepancyResult | null} result
 * @param {FlightSummary} summary
 * @param {AbortSignal} signal
 */
export function discrepancy(page, result, summary, signal) {
  const id = encodeURIComponent(summary.id)
  if (!result) {
    page.append(nothingYet(summary, 'discrepancy', {
      failed: 'The last analysis failed', missing: 'No model has been questioned by this flight.',
      start: 'Question a model',
    }))
    return
  }
  const [kind, words] = VERDICTS[result.verdict] ?? ['note', result.verdict]
  const bars = h('div', { class: 'plots' })
  page.append(...there(
    remark(kind, h('p', { class: 'verdict' }, words), h('p', {}, result.sentence)),
    quality(result),
    result.warnings?.length && remark('note', h('h2', {}, 'Warnings'), listing(result.warnings)),
    h('p', { class: 'row' }, opened(`/api/flights/${id}/report?of=discrepancy`, 'Report to read and print'),
      download(`/api/flights/${id}/discrepancy`, `${summary.id}-discrepancy.json`, 'Result (JSON)'),
      h('span', { id: 'model-download' })),
    result.effects.length && h('h2', {}, 'Effects'), effects(result),
    h('h2', {}, 'The gap'), h('p', {}, 'The gap of an output is the rms of measured minus free-running simulation, '
      + 'in times of its noise floor: at 1 nothing is left to explain. Coefficients fitted again without an effect '
      + 'are the '
      + 'likeliest from sample to sample, and may simulate five seconds worse than those given.'), bars,
      ...gapTables(result),
    h('h2', {}, 'Measured and simulated'), simulated(result.series, signal),
    h('h2', {}, 'Where it disagrees'), ...where(result, signal),
    ...why(result),
  ))
  gapBars(bars, result, signal)
  modelLink(/** @type {Element} */ (page.querySelector('#model-download')), summary.id, 'discrepancy', signal)
}

/** What to fly to distinguish an effect from its alternatives; nothing where there are none. @param {Effect} one */
export const separation = one => one.alternatives.length && one.separating_manoeuvre || NONE

/** The tests behind the verdict, and what was known beforehand. @param {DiscrepancyResult} result */
function why({ reasons = [], ruled_out: ruledOut = [] }) {
  const all = ruledOut.length ? [...reasons, `ruled out beforehand: ${ruledOut.join(', ')}`] : reasons
  return all.length ? [h('h2', {}, 'Why'), listing(all)] : []
}

/** The unit behind a parameter's value; nothing of one without. @param {Coefficient} entry */
const unitOf = ({ unit = '1' }) => unit === '1' ? '' : ` ${unit}`

/** @param {DiscrepancyResult} result */
function effects(result) {
  return table('Effects found, and those that these flights cannot distinguish from them',
    ['Effect', 'Probability', 'Parameters', 'Could as well be', 'Would separate them'],
    result.effects.map(one => [
      h('span', {}, h('code', {}, one.name), one.title ? ` (${one.title})` : ''),
      probability(one.probability),
      Object.entries(one.parameters ?? {}).map(([name, entry]) =>
        h('div', {}, h('code', {}, name), ` ${plusMinus(entry)}`, unitOf(entry))),
      one.alternatives.length
        ? one.alternatives.map(other => h('div', {}, `${other.name}, ${probability(other.probability)}`))
        : 'nothing else',
      separation(one),
    ]))
}

/** Stages of a gap that are drawn: `after` only where an effect was added. @param {Gap} gap @param {string} verdict */
const stages = (gap, verdict) => Object.keys(STAGES).filter(stage => gap[stage]
  && (stage !== 'after' || verdict === 'missing_effect'))

/** @param {DiscrepancyResult} result */
function gapTables({ gap, verdict }) {
  return Object.entries(gap).flatMap(([use, one]) => !one?.noise_floor ? [] : h('details', { class: 'panel' },
    h('summary', {}, `${USES[use] ?? use}: the numbers`),
    table(`Gap of each output. ${USES[use] ?? use}`,
      ['Output', 'Unit', ...stages(one, verdict).map(s => STAGES[s]), 'Noise floor'],
      Object.keys(one.noise_floor).map(name => {
        const [unit, factor] = shownUnit(UNITS[name])
        /** @param {number} value */
        const cell = value => Number.isFinite(value) ? number(value * factor) : NONE
        return [signalName(name), unit, ...stages(one, verdict).map(s => cell(one[s][name])),
          cell(one.noise_floor[name])]
      }))))
}

/** @param {HTMLElement} place @param {DiscrepancyResult} result @param {AbortSignal} signal */
async function gapBars(place, { gap, verdict }, signal) {
  const Bokeh = await bokeh()
  for (const [use, one] of Object.entries(gap)) {
    if (!one?.noise_floor) continue
    const names = Object.keys(one.noise_floor).filter(name => one.noise_floor[name])
    const drawn = stages(one, verdict)
    /** @param {string} stage @param {string} name */
    const ratio = (stage, name) => Number.isFinite(one[stage][name]) ? one[stage][name] / one.noise_floor[name] : null
    const most = Math.max(2, ...drawn.flatMap(stage => names.map(name => ratio(stage, name) ?? 0)))
    const figure = await plot({ y: 'gap / noise floor', height: 300, yLog: true,
      yRange: new Bokeh.Range1d({ start: 0.3, end: 1.6 * most }),
      xRange: new Bokeh.FactorRange({ factors: names, range_padding: 0.05 }) })
    const width = 0.8 / drawn.length
    for (const [index, stage] of drawn.entries()) {
      const data = new Bokeh.ColumnDataSource({ data: {
        at: names.map(name => [name, (index - (drawn.length - 1) / 2) * width]),
        top: names.map(name => ratio(stage, name) ?? NaN),
      } })
      figure.vbar({ x: { field: 'at' }, top: { field: 'top' }, bottom: 0.01, width: 0.9 * width, source: data,
        fill_color: COLOURS[ORDER.indexOf(stage)], line_color: BLACK,
        hatch_pattern: { given: ' ', before: '/', after: '.' }[stage],
        hatch_color: '#fff', legend_label: STAGES[stage] })
    }
    await level(figure, 1)
    legendAbove(figure)
    figure.xaxes.forEach((/** @type {BokehObject} */ axis) => { axis.major_label_orientation = Math.PI / 2 })
    const last = drawn[drawn.length - 1]
    const worst = names.reduce((a, b) => (ratio(last, a) ?? 0) > (ratio(last, b) ?? 0) ? a : b)
    place.append(await shown(figure, `${USES[use] ?? use}: ${drawn.map(stage => `${STAGES[stage]} up to `
      + `${number(Math.max(...names.map(name => ratio(stage, name) ?? 0)), 2)}`).join(', ')} times the noise floor; `
      + `most is left of ${signalName(worst)}`, signal))
  }
}

/** @param {DiscrepancyResult['series']} series @param {AbortSignal} signal */
function simulated(series, signal) {
  const flights = Object.entries(series ?? {}).flatMap(([use, list]) => (list ?? []).map(one => ({ ...one, use })))
  if (!flights.length) return remark('note', h('p', {}, 'The result holds no curves.'))
  const names = Object.keys(flights[0].outputs)
  const place = h('div', { class: 'plots' })
  /** @param {string} name */
  const draw = async name => {
    const made = []
    for (const flight of flights.filter(one => one.outputs[name])) made.push(await simulations(flight, name, signal))
    place.replaceChildren(...made)
  }
  draw(names[0])
  return h('div', {}, field('Output', select(names.map(name => [name, signalName(name)]), names[0], draw)), place)
}

/** @param {SimulatedFlight & { use: string }} flight @param {string} name @param {AbortSignal} signal */
async function simulations(flight, name, signal) {
  const [unit, factor] = shownUnit(UNITS[name])
  const entry = flight.outputs[name]
  const drawn = ['measured', ...Object.keys(STAGES).filter(stage => entry[stage])]
  const scaled = Object.fromEntries(drawn.map(key => [key, entry[key].map(v => v === null ? null : v * factor)]))
  const data = await source({ time: flight.time_s, ...scaled })
  const measured = scaled.measured.filter(v => v !== null)
  const [low, high] = [Math.min(...measured), Math.max(...measured)]
  const margin = 0.6 * Math.max(high - low, 1e-9)
  const figure = await plot({ x: 'time, s', y: `${signalName(name)}, ${unit}`, height: 260,
    yRange: [low - margin, high + margin] })
  figure.line({ field: 'time' }, { field: 'measured' },
    { source: data, line_color: BLACK, line_alpha: 0.35, line_width: 7, legend_label: 'measured' })
  for (const key of drawn.slice(1)) line(figure, data, 'time', key, ORDER.indexOf(key), STAGES[key], 3)
  legendAbove(figure)
  return shown(figure, `${USES[flight.use]}, ${flight.flight}: ${signalName(name)} as measured and as simulated from `
    + 'windows of 5 s', signal)
}

/** @param {DiscrepancyResult} result @param {AbortSignal} signal */
function where(result, signal) {
  if (!result.where.length) return [h('p', {}, 'Nowhere beyond chance.')]
  const plots = h('div', { class: 'plots' })
  curvePlots(plots, result.where, signal)
  return [
    table('Axes that disagree, and the variable that explains it',
      ['Axis', 'Variable', 'Share of the axis’ gap', 'Chance'],
      result.where.map(one =>
        [h('code', {}, one.axis), signalName(one.variable), percent(one.share), chance(one.p_value)])),
    plots,
  ]
}

/** @param {HTMLElement} place @param {Disagreement[]} list @param {AbortSignal} signal */
async function curvePlots(place, list, signal) {
  for (const { axis, variable, curve } of list) {
    if (!curve?.length) continue
    const figure = await plot({ x: [signalName(variable), VARIABLES[variable]].filter(Boolean).join(', '),
      y: `residual of ${axis}`, height: 200 })
    const data = await source({
      x: curve.map(point => point.value), y: curve.map(point => point.residual),
      low: curve.map(point => point.residual - 1.96 * point.std),
      high: curve.map(point => point.residual + 1.96 * point.std),
    })
    band(figure, data, 'x', 'low', 'high')
    line(figure, data, 'x', 'y', 0)
    await level(figure, 0, 'solid')
    place.append(await shown(figure, `Residual of ${axis} over ${signalName(variable)} with 95 % band`, signal))
  }
}
