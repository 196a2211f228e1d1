// The attitude and the figures that a pilot's helper reads at arm's length.

import { h, svg } from './dom.js'
import { NONE, number } from './format.js'

const DEGREES = 180 / Math.PI
const TILES = [
  [['airspeed', 'V'], 'Airspeed', 'm/s', 1, 1], [['alpha'], 'α', '°', DEGREES, 1], [['beta'], 'β', '°', DEGREES, 1],
  [['phi'], 'Roll', '°', DEGREES, 0], [['theta'], 'Pitch', '°', DEGREES, 0], [['psi'], 'Heading', '°', DEGREES, 0],
  [['height', 'altitude'], 'Height', 'm', 1, 0], [['thrust'], 'Thrust', 'N', 1, 1],
]
const PER_DEGREE = 2

/** A horizon and tiles with the newest values. */
export class Instruments {
  constructor() {
    this.values = {}
    this.tiles = TILES.map(([names, title, unit, factor, decimals]) => {
      const value = h('dd', {}, NONE)
      return { names, factor, decimals, value, element: h('div', { class: 'tile' }, h('dt', {}, `${title}, ${unit}`), value) }
    })
    this.ground = svg('g', {}, svg('rect', { x: -300, y: 0, width: 600, height: 400, class: 'earth' }),
      svg('path', { d: 'M-300 0H300', class: 'skyline' }),
      [-30, -20, -10, 10, 20, 30].map(angle => svg('path', { d: `M-18 ${-PER_DEGREE * angle}h36`, class: 'ladder' })))
    this.picture = svg('svg', { viewBox: '-100 -75 200 150', preserveAspectRatio: 'xMidYMid slice', role: 'img', class: 'horizon', 'aria-label': 'Attitude: not known' },
      svg('rect', { x: -300, y: -400, width: 600, height: 800, class: 'sky' }), this.ground,
      svg('path', { d: 'M-60 0h35l10 12M60 0h-35l-10 12M-3 0h6', class: 'aircraft' }))
    this.element = h('div', { class: 'instruments' }, this.picture,
      h('dl', { class: 'tiles' }, this.tiles.map(tile => tile.element)))
    this.elements = [h('h2', { class: 'unseen' }, 'Instruments'), this.element]
  }

  /** Grey them while no connection tells new values. */
  stale(is) {
    this.element.classList.toggle('stale', is)
  }

  /** Take the newest values by signal name, in SI. */
  show(signals) {
    Object.assign(this.values, signals)
    for (const { names, factor, decimals, value } of this.tiles) {
      const found = names.map(name => this.values[name]).find(Number.isFinite)
      value.textContent = found === undefined ? NONE : (found * factor).toFixed(decimals).replace(/^-(?=[0.]*$)/, '').replace('-', '−')
    }
    const { phi, theta } = this.values
    if (!Number.isFinite(phi) || !Number.isFinite(theta)) return
    const pitch = Math.max(-40, Math.min(40, theta * DEGREES))
    this.ground.setAttribute('transform', `rotate(${(-phi * DEGREES).toFixed(2)}) translate(0 ${(PER_DEGREE * pitch).toFixed(2)})`)
    this.picture.setAttribute('aria-label', `Attitude: roll ${number(Math.round(phi * DEGREES))}, pitch ${number(Math.round(theta * DEGREES))} degrees`)
  }
}
