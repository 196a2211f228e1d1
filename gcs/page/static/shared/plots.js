// Plots by BokehJS, which is loaded when the first of them is wanted. Every plot is a figure with a caption in words.

import { h } from './dom.js'

// Blue, red, green, orange, purple, ink; paper and grid.
const OF_THEME = {
  light: ['#0b4fc4', '#b3261e', '#00695c', '#b45309', '#6a1b9a', '#000', '#fff', '#bbb'],
  dark: ['#7fb2ff', '#ff8a80', '#5fd3bc', '#ffb74d', '#ce93d8', '#f5f5f5', '#10151c', '#46505e'],
}
// Those of the theme that is shown when a plot is made: whoever imports them sees the present ones.
export let COLOURS = OF_THEME.light
export let [BLUE, RED, , , , BLACK] = COLOURS
let [, , , , , , PAPER, GRID] = COLOURS

function paint() {
  COLOURS = OF_THEME[document.documentElement.dataset.theme === 'dark' ? 'dark' : 'light']
  ;[BLUE, RED, , , , BLACK, PAPER, GRID] = COLOURS
}

const axisStyle = () => ({
  axis_label_text_font_size: '15px', axis_label_text_font_style: 'normal', axis_label_text_color: BLACK,
  major_label_text_font_size: '14px', major_label_text_color: BLACK, axis_line_color: BLACK,
  major_tick_line_color: BLACK, minor_tick_line_color: BLACK,
})
const DASHES = ['solid', 'dashed', 'solid', 'dotdash', 'solid', 'dashed']

/** @type {Promise<BokehObject> | null} */
let loading = null

/** BokehJS, loaded once. */
export function bokeh() {
  /** @type {HTMLMetaElement | null} */
  const meta = document.querySelector('meta[name=plots]')
  if (!meta) throw new Error('the document names no plotting library')
  loading ??= meta.content.split(' ')
    .reduce((before, address) => before.then(() => load(address)), /** @type {Promise<unknown>} */ (Promise.resolve()))
    .then(() => {
      window.Bokeh.set_log_level('error')
      return window.Bokeh
    })
  return loading
}

/** @param {string} address */
const load = address => new Promise((resolve, reject) => {
  const script = h('script', { src: address, load: resolve, error: () => {
    loading = null
    reject(new Error('the plots could not be loaded from the ground station; load the page again'))
  } })
  document.head.append(script)
})

/**
 * An empty Bokeh plot, its axes named.
 * options: height (px), x, y (axis labels), xRange (a Range1d shared with others), yRange ([low, high] or names),
 * xLog, yLog, counted (whole numbers along x), names (categories along x), select (drag with a mouse zooms in time).
 * @param {PlotOptions} options
 * @returns {Promise<BokehObject>}
 */
export async function plot(options) {
  const Bokeh = await bokeh()
  paint()
  const fine = matchMedia('(pointer: fine)').matches && options.select
  const figure = Bokeh.Plotting.figure({
    height: options.height ?? 220, sizing_mode: 'stretch_width', toolbar_location: null, min_width: 200,
    tools: fine ? 'xbox_zoom' : '', x_axis_label: options.x ?? '', y_axis_label: options.y ?? '',
    ...(options.xRange ? { x_range: options.xRange } : {}), ...(options.yRange ? { y_range: options.yRange } : {}),
    ...(options.xLog ? { x_axis_type: 'log' } : {}), ...(options.yLog ? { y_axis_type: 'log' } : {}),
    min_border_right: 12, min_border_left: 74,
  })
  for (const axis of [...figure.xaxes, ...figure.yaxes]) Object.assign(axis, axisStyle())
  if (options.counted) {
    const ticker = new Bokeh.BasicTicker({ min_interval: 1, num_minor_ticks: 0 })
    for (const one of [...figure.xaxes, ...figure.xgrids]) one.ticker = ticker
  }
  figure.xgrids.concat(figure.ygrids).forEach((/** @type {BokehObject} */ grid) => { grid.grid_line_color = GRID })
  Object.assign(figure, { outline_line_color: BLACK, background_fill_color: PAPER, border_fill_color: PAPER })
  return figure
}

/**
 * A further axis on the right, of a range of its own: { name, range }.
 * @param {BokehObject} figure
 * @param {string} label
 * @returns {Promise<FurtherAxis>}
 */
export async function furtherAxis(figure, label) {
  const Bokeh = await bokeh()
  const range = new Bokeh.DataRange1d({ renderers: [] })
  const name = `further ${label}`
  figure.extra_y_ranges = { ...figure.extra_y_ranges, [name]: range }
  const axis = new Bokeh.LinearAxis({ y_range_name: name, axis_label: label })
  figure.add_layout(Object.assign(axis, axisStyle()), 'right')
  return { name, range }
}

/**
 * Columns of numbers as a source that plots share; null becomes a gap.
 * @param {Columns} columns
 * @returns {Promise<BokehSource>}
 */
export async function source(columns) {
  const Bokeh = await bokeh()
  return new Bokeh.ColumnDataSource({ data: gaps(columns) })
}

/** @param {Columns} columns @returns {Record<string, number[]>} */
export const gaps = columns => Object.fromEntries(Object.entries(columns).map(([name, values]) =>
  [name, values.map(value => value ?? NaN)]))

/**
 * A line of a source's columns; index: which colour and dash.
 * @param {BokehObject} figure
 * @param {BokehSource} data
 * @param {string} x
 * @param {string} y
 * @param {number} index
 * @param {string | null} [legend]
 * @param {number} [width]
 * @param {{ name: string } | null} [axis] a further one that it goes by
 */
export const line = (figure, data, x, y, index, legend, width = 2.5, axis = null) =>
  figure.line({ field: x }, { field: y }, {
    source: data, ...(axis ? { y_range_name: axis.name } : {}), line_color: COLOURS[index % 6], line_width: width,
    line_dash: DASHES[index % 6],
    ...(legend ? { legend_label: legend } : {}),
  })

/**
 * A band between two columns.
 * @param {BokehObject} figure
 * @param {BokehSource} data
 * @param {string} x
 * @param {string} low
 * @param {string} high
 */
export const band = (figure, data, x, low, high, colour = BLUE) => figure.varea({
  x: { field: x }, y1: { field: low }, y2: { field: high }, source: data, fill_color: colour, fill_alpha: 0.25,
})

/** A horizontal line over the whole width. @param {BokehObject} figure @param {number} value */
export async function level(figure, value, dash = 'dashed') {
  const Bokeh = await bokeh()
  figure.add_layout(new Bokeh.Span({
    location: value, dimension: 'width', line_color: BLACK, line_dash: dash, line_width: 1.5,
  }))
}

/** The legend on one line above the plot, in large type. @param {BokehObject} figure */
export function legendAbove(figure) {
  const { legend } = figure
  Object.assign(legend, {
    orientation: 'horizontal', label_text_font_size: '15px', label_text_color: BLACK, border_line_color: null,
    padding: 0, margin: 0, spacing: 12, background_fill_alpha: 0.85, background_fill_color: PAPER,
  })
  /** @type {BokehObject[]} */
  const parts = figure.center
  figure.center = parts.filter(part => part.type !== 'Legend')
  parts.filter(part => part.type === 'Legend').forEach(part => figure.add_layout(part, 'above'))
}

/**
 * A figure element with the plot in it. The picture is one image to screen readers, described by its caption.
 * signal: when it is aborted, the plot is taken away.
 * @param {BokehObject} figure
 * @param {string} caption
 * @param {AbortSignal} [signal]
 */
export async function shown(figure, caption, signal) {
  const Bokeh = await bokeh()
  const picture = h('div', { class: 'plot', role: 'img', 'aria-label': caption })
  const words = h('figcaption', {}, caption)
  const element = /** @type {PlotElement} */ (h('figure', {}, picture, words))
  const place = async () => {
    const view = await Bokeh.Plotting.show(figure, picture)
    element.view = view
    const end = () => {
      signal?.removeEventListener('abort', end)
      // The library keeps every document that it has shown, and a view of its notices beside that of the plot.
      const { document } = view.model
      document.views_manager?.clear()
      view.remove()
      if (Bokeh.documents.includes(document)) Bokeh.documents.splice(Bokeh.documents.indexOf(document), 1)
    }
    signal?.addEventListener('abort', end)
    element.end = end
    if (element.ended) end()
  }
  element.placed = whenInDocument(element).then(place)
  element.say = text => {
    words.textContent = text
    picture.setAttribute('aria-label', text)
  }
  return element
}

/**
 * Take a plot away for good: what draws it would stay in memory for as long as the view does.
 * @param {PlotElement} element
 */
export function removePlot(element) {
  element.ended = true
  element.end?.()
  element.remove()
}

/** Bokeh measures its place, so the plot is drawn once its element is part of the page. @param {PlotElement} element */
async function whenInDocument(element) {
  while (!element.isConnected && !element.ended) await new Promise(requestAnimationFrame)
}
