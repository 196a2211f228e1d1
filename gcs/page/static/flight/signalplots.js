// The ways to draw signals: over time, each or by unit; one against another; as spectra.

import { nearest } from './cursor.js'
import { h } from '../shared/dom.js'
import { number, shownUnit, signalName } from '../shared/format.js'
import { bokeh, furtherAxis, gaps, legendAbove, line, plot, shown, source } from '../shared/plots.js'

const GREEN_BAND = '#8fce9b'
const MOST_MODES = 40
const DEEPEST_DB = 60  // below the strongest
const STILL_DB = -200  // what rounding leaves of a signal that stands still

/**
 * Plots over time, below each other; the signals of one plot that have another unit than its first go by an axis on the
 * right.
 * groups: the names of each plot. found: series by name. used, modes: parts that were identified, shaded, and
 * of the autopilot's modes, which begin at dotted lines.
 * moved: called with the range of a plot that was zoomed in.
 * @param {string[][]} groups
 * @param {Record<string, Series>} found
 * @param {{ start: number, end: number }} range
 * @param {FlightSummary} summary
 * @param {(range: BokehRange) => void} moved
 * @param {AbortSignal} signal
 * @returns {Promise<TimedPlot[]>}
 */
export async function overTime(groups, found, range, { used, modes }, moved, signal) {
  const Bokeh = await bokeh()
  const made = []
  for (const group of groups) {
    const own = new Bokeh.Range1d(range)
    const units = [...new Set(group.map(name => shownUnit(found[name].unit)[0]))]
    const figure = await plot({ x: 'time, s', y: units[0], xRange: own, height: group.length > 1 ? 300 : 200,
      select: true })
    /** @type {Record<string, FurtherAxis | null>} by unit; null is the plot's own axis */
    const axes = { [units[0]]: null }
    for (const unit of units.slice(1)) axes[unit] = await furtherAxis(figure, unit)
    for (const { start, end } of used) {
      figure.add_layout(new Bokeh.BoxAnnotation({ left: start, right: end, fill_color: GREEN_BAND, fill_alpha: 0.25,
        line_color: null, level: 'underlay' }))
    }
    for (const { start } of modes.slice(1, MOST_MODES)) {
      figure.add_layout(new Bokeh.Span({ location: start, dimension: 'height', line_color: '#6a1b9a',
        line_dash: 'dotted', line_width: 2 }))
    }
    /** @type {Record<string, BokehSource>} */
    const kept = {}
    /** @type {BokehObject[]} */
    const ofFirst = []
    for (const [index, name] of group.entries()) {
      const [unit, factor] = shownUnit(found[name].unit)
      kept[name] = await source(columns(found[name], factor))
      const drawn = line(figure, kept[name], 'x', 'y', index,
        group.length > 1 ? named(name, units.length > 1 ? unit : '') : null, 2.5, axes[unit])
      const further = axes[unit]
      if (further) further.range.renderers = [...further.range.renderers, drawn]
      else ofFirst.push(drawn)
    }
    // Each axis goes by its own lines alone.
    figure.y_range.renderers = ofFirst
    if (group.length > 1) legendAbove(figure)
    /** @param {Record<string, Series>} series */
    const words = series => group.map(name => caption(name, series[name])).join('. ')
    const element = await shown(figure, words(found), signal)
    element.prepend(h('h3', {},
      `${group.map(name => units.length > 1 ? named(name, shownUnit(found[name].unit)[0]) : signalName(name))
        .join(', ')}${units.length === 1 && units[0] ? `, ${units[0]}` : ''}`))
    own.change.connect(() => moved(own))
    const lines = () => group.map(name =>
      ({ name, unit: shownUnit(found[name].unit)[0], time: kept[name].data.x, value: kept[name].data.y }))
    /** @param {Record<string, Series>} series */
    const take = series => {
      for (const name of group) kept[name].data = columns(series[name], shownUnit(found[name].unit)[1])
      element.say(words(series))
    }
    made.push({ element, names: group, range: own, lines, take })
  }
  return made
}

/**
 * The others against the first of them, at its moments.
 * @param {string[]} names
 * @param {Record<string, Series>} found
 * @param {AbortSignal} signal
 * @returns {Promise<SignalPlot[]>}
 */
export async function againstEachOther(names, found, signal) {
  const [first, ...others] = names
  const [acrossUnit, across] = shownUnit(found[first]?.unit)
  const made = []
  for (const name of others) {
    const [unit, factor] = shownUnit(found[name].unit)
    const { time, value } = found[name]
    const figure = await plot({ x: named(first, acrossUnit), y: named(name, unit), height: 360 })
    const data = await source(gaps({
      x: found[first].value.map(v => v === null ? null : v * across),
      y: found[first].time.map(at => {
        const near = time.length ? value[nearest(time, at)] : null
        return near === null ? null : near * factor
      }),
    }))
    figure.scatter({ field: 'x' }, { field: 'y' },
      { source: data, size: 3, line_color: null, fill_color: '#0b4fc4', fill_alpha: 0.5 })
    const element = await shown(figure,
      `${signalName(name)} against ${signalName(first)}, ${found[first].time.length} moments`, signal)
    element.prepend(h('h3', {}, `${signalName(name)} against ${signalName(first)}`))
    made.push({ element, names: [first, name] })
  }
  return made.length ? made : [{ element: h('figure', {},
    h('p', {}, 'Choose a second signal: it is drawn against the first one.')), names: [first] }]
}

/**
 * Power spectral densities over frequency, both axes logarithmic.
 * @param {string[]} names
 * @param {Record<string, Spectrum>} found
 * @param {AbortSignal} signal
 * @returns {Promise<SignalPlot[]>}
 */
export async function spectra(names, found, signal) {
  const made = []
  for (const name of names) {
    const { frequency, value, signal_unit } = found[name]
    const [shownAs, factor] = shownUnit(signal_unit)
    const unit = shownAs ? `(${shownAs})²/Hz` : '1/Hz'
    const figure = await plot({ x: 'frequency, Hz', y: unit, height: 260, xLog: true, yLog: true })
    line(figure, await source({ x: frequency, y: value.map(v => v * factor ** 2 || null) }), 'x', 'y', 0)
    const strongest = frequency[value.indexOf(Math.max(...value))]
    const element = await shown(figure,
      frequency.length ? `Power spectral density of ${signalName(name)}; strongest at ${number(strongest)} Hz`
        : `${signalName(name)}: too few values in this stretch for a spectrum`, signal)
    element.prepend(h('h3', {}, `${signalName(name)}, ${unit}`))
    made.push({ element, names: [name] })
  }
  return made
}

/**
 * Power spectral densities over time: frequency upwards, the density as colour, with its scale beside it.
 * @param {string[]} names
 * @param {Record<string, Spectrogram>} found
 * @param {AbortSignal} signal
 * @returns {Promise<SignalPlot[]>}
 */
export async function spectrograms(names, found, signal) {
  const Bokeh = await bokeh()
  const made = []
  for (const name of names) {
    const { time, frequency, signal_unit } = found[name]
    const [unit, factor] = shownUnit(signal_unit)
    const value = found[name].value.map(row => row.map(one => one === null ? null : one + 20 * Math.log10(factor)))
    const heading = h('h3', {}, `${signalName(name)}, dB of 1 ${unit ? `(${unit})²` : ''}/Hz`)
    const levels = value.flat().filter(one => one !== null)
    const most = levels.reduce((a, b) => Math.max(a, b), -Infinity)
    if (most < STILL_DB) {
      const why = time.length ? 'does not change in this stretch' : 'too few values in this stretch for spectra'
      made.push({ element: h('figure', {}, heading, h('figcaption', {}, `${signalName(name)}: ${why}`)),
        names: [name] })
      continue
    }
    const [step, width] = [frequency[1] - frequency[0], time.length > 1 ? time[1] - time[0] : 1]
    const [left, right] = [time[0] - width / 2, time[time.length - 1] + width / 2]
    const [low, high] = [Math.max(frequency[0] - step / 2, 0), frequency[frequency.length - 1] + step / 2]
    const mapper = new Bokeh.LinearColorMapper({ palette: Bokeh.Palettes.Viridis256,
      low: Math.max(levels.reduce((a, b) => Math.min(a, b), Infinity), most - DEEPEST_DB), high: most,
      nan_color: '#fff' })
    const figure = await plot({ x: 'time, s', y: 'frequency, Hz', height: 300, yRange: [low, high],
      xRange: new Bokeh.Range1d({ start: left, end: right }) })
    const image = { shape: [frequency.length, time.length], dtype: 'float64' }
    const pixels = Bokeh.require('core/util/ndarray').ndarray(Float64Array.from(value.flat(), one => one ?? NaN), image)
    const data = new Bokeh.ColumnDataSource({ data: { image: [pixels] } })
    figure.image(mapper, { field: 'image' }, { value: left }, { value: low }, { value: right - left },
      { value: high - low }, { source: data })
    figure.add_layout(new Bokeh.ColorBar({ color_mapper: mapper, title: 'dB', width: 14, padding: 4,
      major_label_text_font_size: '13px', major_label_text_color: '#000', title_text_color: '#000' }), 'right')
    const peaks = value.map((row, at) =>
      [row.reduce((/** @type {number} */ a, b) => Math.max(a, b ?? -Infinity), -Infinity), frequency[at]])
    const strongest = peaks.reduce((a, b) => b[0] > a[0] ? b : a)
    const element = await shown(figure,
      `Power spectral density of ${signalName(name)} over time; strongest at ${number(strongest[1])} Hz with `
        + `${number(strongest[0])} dB`, signal)
    element.prepend(heading)
    made.push({ element, names: [name] })
  }
  return made
}

/** @param {string} name @param {string} unit */
const named = (name, unit) => `${signalName(name)}${unit ? `, ${unit}` : ''}`

/** The names by unit. @param {string[]} names @param {Record<string, Series>} found @returns {string[][]} */
export function byUnit(names, found) {
  /** @type {Map<string, string[]>} */
  const groups = new Map()
  for (const name of names) {
    const unit = found[name].unit
    groups.set(unit, [...groups.get(unit) ?? [], name])
  }
  return [...groups.values()]
}

/** @param {Series} series @param {number} factor */
const columns = (series, factor) => gaps({ x: series.time, y: series.value.map(v => v === null ? null : v * factor) })

/** What a signal does in the stretch, in words. @param {string} name @param {Series} series */
export function caption(name, series) {
  const [unit, factor] = shownUnit(series.unit)
  const values = series.value.filter(value => value !== null).map(value => value * factor)
  if (!values.length) return `${signalName(name)}: no value in this stretch`
  const [low, high] = values.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity])
  return `${signalName(name)} lies between ${number(low)} and ${number(high)} ${unit}, from ${series.source}`
}
