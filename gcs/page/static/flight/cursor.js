// One cursor through all plots of a time axis: a line in each, and the values there in a row that stays in sight.

import { h } from '../shared/dom.js'
import { NONE, number, signalName } from '../shared/format.js'

/** Follows the pointer over plots, or the arrow keys, and says what each signal is there. */
export class Cursor {
  constructor() {
    /** @type {TimedPlot[]} */
    this.plots = []
    /** @type {number | null} */
    this.time = null
    /** @type {number | null} */
    this.frame = null
    this.element = h('output', { class: 'cursor', tabindex: 0, 'aria-live': 'off', 'aria-label': 'Values at the cursor',
      keydown: event => this.key(event) },
      'Point at a plot, or focus this line and press an arrow key, to read values. Drag along one with the mouse to '
        + 'see that stretch alone.')
  }

  /**
   * plots: of { element, lines: [{ name, unit, time, value }], range }, one for each figure.
   * @param {TimedPlot[]} plots
   */
  show(plots) {
    this.plots = plots
    this.sizes?.disconnect()
    this.sizes = new ResizeObserver(() => this.time === null || this.move(this.time))
    for (const plot of plots) {
      const picture = /** @type {HTMLElement} */ (plot.element.querySelector('.plot'))
      plot.line = h('div', { class: 'cursor-line', hidden: true })
      picture.append(plot.line)
      this.sizes.observe(picture)
      const follow = (/** @type {PointerEvent} */ event) =>
        this.point(plot, event.clientX - picture.getBoundingClientRect().left)
      picture.addEventListener('pointermove', follow)
      picture.addEventListener('pointerdown', follow)
    }
    if (this.time !== null) this.move(this.time)
  }

  /** @param {TimedPlot} plot @param {number} x */
  point(plot, x) {
    const box = plot.element.view?.frame.bbox
    if (!box) return
    const share = (x - box.left) / box.width
    if (share < 0 || share > 1) return
    this.move(plot.range.start + share * (plot.range.end - plot.range.start))
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    /** @type {Record<string, number>} */
    const known = { ArrowLeft: -1, ArrowRight: 1, PageUp: -20, PageDown: 20 }
    const steps = known[event.key]
    if (!steps || !this.plots.length) return
    event.preventDefault()
    const { start, end } = this.plots[0].range
    this.move(Math.min(end, Math.max(start, (this.time ?? start) + steps * (end - start) / 200)))
  }

  /** Put the cursor at a time, s; the next frame shows it. @param {number} time */
  move(time) {
    this.time = time
    this.frame ??= requestAnimationFrame(() => {
      this.frame = null
      this.draw()
    })
  }

  draw() {
    const { time: now } = this
    if (now === null) return
    /** @type {string[]} */
    const said = []
    for (const { element, line, lines, range } of this.plots) {
      const box = element.view?.frame.bbox
      if (!line) continue
      const share = (now - range.start) / (range.end - range.start)
      line.hidden = !box || share < 0 || share > 1
      if (box) Object.assign(line.style,
        { left: `${box.left + share * box.width}px`, top: `${box.top}px`, height: `${box.height}px` })
      for (const { name, unit, time, value } of lines()) {
        const read = shownValue(value[nearest(time, now)])
        said.push(`${signalName(name)} ${read}${unit ? ` ${unit}` : ''}`)
      }
    }
    this.element.replaceChildren(h('b', {}, `${now.toFixed(3)} s`), ...said.map(text => h('span', {}, text)))
  }
}

/** @param {number} value */
const shownValue = value => Number.isFinite(value) ? number(value, 4) : NONE

/** Index of the sample nearest to a time; times ascend. @param {number[]} times @param {number} time */
export function nearest(times, time) {
  let [low, high] = [0, times.length - 1]
  while (high - low > 1) {
    const middle = (low + high) >> 1
    if (times[middle] <= time) low = middle
    else high = middle
  }
  return Math.abs(times[low] - time) <= Math.abs(times[high] - time) ? low : high
}
