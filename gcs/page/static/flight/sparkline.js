// How a flight went, in one small line for a list.

import { newId, svg } from '../shared/dom.js'
import { number, shownUnit, signalName } from '../shared/format.js'

const WIDTH = 120
const HEIGHT = 28
const EDGE = 2

/**
 * The line of an outline as the list of flights gives it; nothing of none. A stretch without a value is a gap.
 * @param {Outline | null} outline
 */
export function sparkline(outline) {
  const known = outline?.values.filter(value => value !== null) ?? []
  if (!outline || !known.length) return ''
  const [unit, factor] = shownUnit(outline.unit)
  const [low, high] = [Math.min(...known), Math.max(...known)]
  /** @param {number} at */
  const x = at => EDGE + at * (WIDTH - 2 * EDGE) / Math.max(outline.values.length - 1, 1)
  /** @param {number} value */
  const y = value => high > low ? HEIGHT - EDGE - (value - low) * (HEIGHT - 2 * EDGE) / (high - low) : HEIGHT / 2
  let pen = 'M'
  const path = outline.values.map((value, at) => {
    if (value === null) {
      pen = 'M'
      return ''
    }
    const piece = `${pen}${x(at).toFixed(1)} ${y(value).toFixed(1)}`
    pen = 'L'
    return piece
  }).join('')
  const title = newId('course')
  return svg('svg', { class: 'sparkline', width: WIDTH, height: HEIGHT, viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: 'img',
    'aria-labelledby': title },
    svg('title', { id: title },
      `${signalName(outline.name)} from ${number(low * factor)} to ${number(high * factor)} ${unit}`),
    svg('path', { d: path }))
}
