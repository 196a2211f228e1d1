// The ways to draw signals: over time, each or by unit; one against another; as spectra.

import { nearest } from './cursor.js'
import { h } from './dom.js'
import { number, shownUnit, signalName } from './format.js'
import { bokeh, gaps, legendAbove, line, plot, shown, source } from './plots.js'

const GREEN_BAND = '#8fce9b'
const MOST_MODES = 40

/**
 * Plots over time, below each other.
 * found: series by name. together: those of one unit in one plot. used, modes: parts that were identified, shaded, and
 * of the autopilot's modes, which begin at dotted lines.
 * moved: called with the range of a plot that was zoomed in.
 */
export async function overTime(names, found, range, together, { used, modes }, moved, signal) {
  const Bokeh = await bokeh()
  const made = []
  for (const group of together ? byUnit(names, found) : names.map(name => [name])) {
    const own = new Bokeh.Range1d(range)
    const [unit, factor] = shownUnit(found[group[0]].unit)
    const figure = await plot({ x: 'time, s', y: unit, xRange: own, height: group.length > 1 ? 300 : 200, select: true })
    for (const { start, end } of used) {
      figure.add_layout(new Bokeh.BoxAnnotation({ left: start, right: end, fill_color: GREEN_BAND, fill_alpha: 0.25, line_color: null, level: 'underlay' }))
    }
    for (const { start } of modes.slice(1, MOST_MODES)) {
      figure.add_layout(new Bokeh.Span({ location: start, dimension: 'height', line_color: '#6a1b9a', line_dash: 'dotted', line_width: 2 }))
    }
    const kept = {}
    for (const [index, name] of group.entries()) {
      kept[name] = await source(columns(found[name], factor))
      line(figure, kept[name], 'x', 'y', index, group.length > 1 ? signalName(name) : null)
    }
    if (group.length > 1) legendAbove(figure)
    const words = series => group.map(name => caption(name, series[name])).join('. ')
    const element = await shown(figure, words(found), signal)
    element.prepend(h('h3', {}, `${group.map(signalName).join(', ')}${unit ? `, ${unit}` : ''}`))
    own.change.connect(() => moved(own))
    const lines = () => group.map(name => ({ name, unit, time: kept[name].data.x, value: kept[name].data.y }))
    const take = series => {
      for (const name of group) kept[name].data = columns(series[name], factor)
      element.say(words(series))
    }
    made.push({ element, range: own, lines, take })
  }
  return made
}

/** The others against the first of them, at its moments. */
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
      y: found[first].time.map(at => time.length && value[nearest(time, at)] !== null ? value[nearest(time, at)] * factor : null),
    }))
    figure.scatter({ field: 'x' }, { field: 'y' }, { source: data, size: 3, line_color: null, fill_color: '#0b4fc4', fill_alpha: 0.5 })
    const element = await shown(figure, `${signalName(name)} against ${signalName(first)}, ${found[first].time.length} moments`, signal)
    element.prepend(h('h3', {}, `${signalName(name)} against ${signalName(first)}`))
    made.push({ element })
  }
  return made.length ? made : [{ element: h('p', {}, 'Choose a second signal: it is drawn against the first one.') }]
}

/** Power spectral densities over frequency, both axes logarithmic. */
export async function spectra(names, found, signal) {
  const made = []
  for (const name of names) {
    const { frequency, value, signal_unit } = found[name]
    const [shownAs, factor] = shownUnit(signal_unit)
    const unit = shownAs ? `(${shownAs})²/Hz` : '1/Hz'
    const figure = await plot({ x: 'frequency, Hz', y: unit, height: 260, xLog: true, yLog: true })
    line(figure, await source({ x: frequency, y: value.map(v => v * factor ** 2 || null) }), 'x', 'y', 0)
    const strongest = frequency[value.indexOf(Math.max(...value))]
    const element = await shown(figure, frequency.length ? `Power spectral density of ${signalName(name)}; strongest at ${number(strongest)} Hz`
      : `${signalName(name)}: too few values in this stretch for a spectrum`, signal)
    element.prepend(h('h3', {}, `${signalName(name)}, ${unit}`))
    made.push({ element })
  }
  return made
}

const named = (name, unit) => `${signalName(name)}${unit ? `, ${unit}` : ''}`

function byUnit(names, found) {
  const groups = new Map()
  for (const name of names) {
    const unit = found[name].unit
    groups.set(unit, [...groups.get(unit) ?? [], name])
  }
  return [...groups.values()]
}

const columns = (series, factor) => gaps({ x: series.time, y: series.value.map(v => v === null ? null : v * factor) })

/** What a signal does in the stretch, in words. */
export function caption(name, series) {
  const [unit, factor] = shownUnit(series.unit)
  const values = series.value.filter(value => value !== null).map(value => value * factor)
  if (!values.length) return `${signalName(name)}: no value in this stretch`
  const [low, high] = values.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity])
  return `${signalName(name)} lies between ${number(low)} and ${number(high)} ${unit}, from ${series.source}`
}
