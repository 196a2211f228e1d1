// What the model is good for: parameters for the autopilot, how much its loops can bear, how the aircraft performs.

import { asking, get, sentence } from '../shared/api.js'
import { field, h, listing, remark, select, table, there } from '../shared/dom.js'
import { NONE, number } from '../shared/format.js'
import { download } from '../shared/links.js'
import { nothingYet } from '../flight/jobs.js'
import { band, legendAbove, line, plot, removePlot, shown, source } from '../shared/plots.js'

const AUTOPILOTS = [['ardupilot', 'ArduPilot'], ['px4', 'PX4']]

/** @type {Record<string, string>} */
const FIGURES = {
  best_glide_ratio: 'Best glide ratio', best_glide_speed: 'Speed for best glide', min_sink: 'Least sink',
  min_sink_speed: 'Speed for least sink', max_climb: 'Best climb', max_climb_speed: 'Speed for best climb',
  max_speed: 'Largest speed in level flight', ceiling: 'Ceiling (climb of 0.5 m/s)',
  min_turn_radius: 'Tightest level turn, radius', stall_speed: 'Stall speed, level',
  drive_efficiency: 'Of the battery’s power at the shaft', min_battery_power: 'Least power of the battery',
  min_battery_power_speed: 'Speed for the longest flight', min_energy_per_km: 'Least energy, still air',
  min_energy_speed: 'Speed for the farthest flight', endurance: 'Longest flight', range: 'Farthest, still air',
}

/** @type {Record<string, string>} */
const OF_LOOPS = {
  gain_margin: 'Gain margin', phase_margin: 'Phase margin', delay_margin: 'Delay margin', crossover: 'Crossover',
  oscillation: 'Oscillates at', bandwidth: 'Bandwidth of the angle', rejection: 'Rejects disturbances below',
  peak_sensitivity: 'Peak of the sensitivity',
}

/** @type {Record<string, string>} */
const LOOPS = { roll: 'Roll', pitch: 'Pitch' }

/**
 * The tab of what follows from the flight's model. result: null where no identification has ended.
 * @param {HTMLElement} page
 * @param {IdentificationResult | null} result
 * @param {FlightSummary} summary
 * @param {AbortSignal} signal
 */
export function use(page, result, summary, signal) {
  if (!result) {
    page.append(nothingYet(summary, 'identify', {
      failed: 'The last identification failed', missing: 'No model has been identified from this flight.',
      start: 'Start an identification',
    }))
    return
  }
  const path = `/api/flights/${encodeURIComponent(summary.id)}`
  const flown = Object.values(result.senders ?? {}).map(one => one.autopilot)
  const parameters = h('div', {}), loops = h('div', {}), sheet = h('div', {})
  const wanted = select(AUTOPILOTS, flown.some(name => name.startsWith('PX4')) ? 'px4' : 'ardupilot',
    value => { into(parameters, signal, own => tuning(path, summary.id, value, own)) })
  const [mass, altitude, battery] = [h('input', { type: 'number', min: 0, step: 'any' }),
    h('input', { type: 'number', min: -500, max: 8000, step: 'any' }),
    h('input', { type: 'number', min: 0, step: 'any' })]
  const again = () => into(sheet, signal, own => performance(path,
    { mass: mass.value, altitude: altitude.value, battery: battery.value }, own))
  page.append(
    h('h2', {}, 'Parameters of the autopilot'),
    h('p', {}, 'Only what the flight shows. Compare line by line with what is set now; nothing is written to an '
      + 'aircraft from here.'),
    field('Autopilot', wanted), parameters,
    h('h2', {}, 'How much its loops can bear'), loops,
    h('h2', {}, 'How it performs'),
    h('form', { class: 'row', submit: event => { event.preventDefault(); again() } },
      field('Take-off mass, kg', mass, 'As in the vehicle file, where nothing is given.'),
      field('Altitude, m', altitude, 'In the standard atmosphere; 0 where nothing is given.'),
      field('Battery, Wh', battery, 'For how long and how far it flies.'),
      h('button', {}, 'Work it out')), sheet,
  )
  // One after another, while the page can be read: the station makes one at a time, each in a process of its own.
  into(parameters, signal, own => tuning(path, summary.id, wanted.value, own))
    .then(() => into(loops, signal, own => margins(path, own)))
    .then(() => { if (!sheet.childElementCount) again() })
}

/**
 * What is being made for a place: asked for something else, it is no longer waited for.
 * @type {WeakMap<Element, AbortController>}
 */
const waited = new WeakMap()

/**
 * Put in a place what is made for it, or why it is not; of several in turn the last.
 * @param {Element} place
 * @param {AbortSignal} signal
 * @param {(own: AbortSignal) => Promise<(Node | string)[]>} make
 */
async function into(place, signal, make) {
  waited.get(place)?.abort()
  if (signal.aborted) return
  const own = new AbortController()
  waited.set(place, own)
  signal.addEventListener('abort', () => own.abort(), { once: true, signal: own.signal })
  emptied(place, h('p', { role: 'status' }, 'Being worked out …'))
  try {
    const made = await make(own.signal)
    if (!own.signal.aborted) emptied(place, ...made)
  } catch (error) {
    if (!own.signal.aborted) emptied(place, remark('note', h('p', {}, sentence(error))))
  }
}

/**
 * A place with something else in it, its plots ended.
 * @param {Element} place
 * @param {...(Node | string)} content
 */
function emptied(place, ...content) {
  for (const drawn of place.querySelectorAll('figure')) removePlot(/** @type {PlotElement} */ (drawn))
  place.replaceChildren(...content)
}

/** @param {(number | null)[] | null | undefined} ends */
const between = ends => ends ? ends.map(one => one === null ? 'beyond' : number(one)).join(' … ') : NONE

/** @param {string} unit */
const unitOf = unit => unit === '1' ? '' : unit === 'us' ? 'µs' : unit

/**
 * @param {string} path
 * @param {string} id
 * @param {string} autopilot
 * @param {AbortSignal} signal
 */
async function tuning(path, id, autopilot, signal) {
  /** @type {TuningSheet} */
  const found = await get(`${path}/tuning?for=${autopilot}`, signal)
  const ending = autopilot === 'px4' ? 'params' : 'param'
  return there(
    found.warnings.length && remark('note', listing(found.warnings)),
    table('Proposed', ['Parameter', 'Now', 'Proposed', '95 % interval', 'Unit', 'Why'], found.parameters.map(one => [
      h('code', {}, one.name), number(one.now, 4), number(one.value, 4), between(one.interval), unitOf(one.unit),
      one.reason]), true),
    found.parameters.length && h('p', { class: 'row' },
      download(`${path}/tuning/file?for=${autopilot}&job=${encodeURIComponent(found.job)}`, `${id}.${ending}`,
        'Parameter file')),
    table('Not proposed', ['Parameter', 'Now', 'Why not'], found.refused.map(one => [
      h('code', {}, one.name), number(one.now, 4), one.refused]), true))
}

/** @param {string} path @param {AbortSignal} signal */
async function margins(path, signal) {
  /** @type {MarginsSheet} */
  const found = await get(`${path}/margins`, signal)
  const names = Object.keys(found.loops)
  const steady = names.filter(name => found.loops[name].stable)
  return there(
    found.warnings.length && remark('note', listing(found.warnings)),
    found.refused.length && listing(found.refused.map(one => `${LOOPS[one.name] ?? one.name}: ${one.refused}`)),
    names.length > steady.length && remark('bad', listing(names.filter(name => !steady.includes(name))
      .map(name => `${LOOPS[name] ?? name}: unstable by this model`))),
    steady.length && table(`Margins at ${number(found.airspeed)} m/s, with 95 % intervals`,
      ['Figure', ...steady.map(name => LOOPS[name] ?? name), 'Unit'], Object.entries(OF_LOOPS).map(([key, words]) => [
        words, ...steady.map(name => figure(found.loops[name][key])), unitOf(found.loops[steady[0]][key].unit)])),
    table('By how much each gain may grow until the loop oscillates',
      ['Parameter', 'Now', 'May grow, times', '95 % interval', 'Oscillates at, Hz'],
      steady.flatMap(name => Object.values(found.loops[name].gains)).map(one => [
        h('code', {}, one.parameter), number(one.now, 4),
        one.may_grow.value === null ? 'without limit' : number(one.may_grow.value),
        between(one.may_grow.interval), number(one.oscillation, 2)])),
    table('Modes against MIL-F-8785C, scaled to the size of the aircraft', ['Mode', 'Quantity', 'Value', 'Level'],
      found.handling.map(one => [one.mode, one.quantity.replaceAll('_', ' '),
        `${number(one.value)} ${unitOf(one.unit)}`, String(one.level)])))
}

/** @param {SheetFigure} entry */
const figure = entry => entry.value === null ? NONE
  : entry.interval ? `${number(entry.value)} (${between(entry.interval)})` : number(entry.value)

/**
 * @param {string} path
 * @param {Record<string, string>} given
 * @param {AbortSignal} signal
 */
async function performance(path, given, signal) {
  /** @type {PerformanceSheet} */
  const found = await get(`${path}/performance?${asking(given)}`, signal)
  return there(
    found.warnings.length && remark('note', listing(found.warnings)),
    table(`With ${number(found.mass, 4)} kg at ${number(found.altitude)} m`,
      ['Figure', 'Value', '95 % interval', 'Unit', 'Remark'],
      Object.entries(found.figures).map(([key, one]) => 'refused' in one
        ? [FIGURES[key] ?? key, NONE, NONE, '', one.refused]
        : [FIGURES[key] ?? key, number(one.value), between(one.interval), unitOf(one.unit),
          one.extrapolated ? 'beyond what was flown' : '']), true),
    found.speeds.length && await polar(found, signal).catch(error => remark('note', h('p', {}, sentence(error)))))
}

/**
 * What the curve shows. known: speeds that were flown, none where nobody knows.
 * @param {boolean} banded
 * @param {number[]} known
 */
function caption(banded, known) {
  if (!known.length) return banded ? 'Drag over airspeed with its 95 % interval' : 'Drag over airspeed'
  const [slowest, fastest] = [number(Math.min(...known)), number(Math.max(...known))]
  return banded ? `Drag over airspeed with its 95 % interval; flown were ${slowest} to ${fastest} m/s`
    : `Drag over airspeed; flown were ${slowest} to ${fastest} m/s`
}

/** @param {PerformanceSheet} found @param {AbortSignal} signal */
async function polar(found, signal) {
  const drawn = await plot({ x: 'airspeed, m/s', y: 'N', height: 300 })
  const rows = found.speeds
  const data = await source({
    speed: rows.map(one => one.speed), drag: rows.map(one => one.drag),
    low: rows.map(one => one.drag_interval?.[0] ?? null), high: rows.map(one => one.drag_interval?.[1] ?? null),
    thrust: rows.map(one => one.thrust_available ?? null),
  })
  const banded = rows.some(one => one.drag_interval)
  if (banded) band(drawn, data, 'speed', 'low', 'high')
  line(drawn, data, 'speed', 'drag', 0, 'drag in level flight')
  if (rows[0].thrust_available !== undefined) line(drawn, data, 'speed', 'thrust', 1, 'thrust at full throttle')
  legendAbove(drawn)
  const known = rows.filter(one => one.extrapolated === false).map(one => one.speed)
  return shown(drawn, caption(banded, known), signal)
}
