// The attitude and the figures that a pilot's helper reads at arm's length. Nothing old stands there as if it were new.

import { h, svg } from '../shared/dom.js'
import { NONE, number } from '../shared/format.js'
import { write } from './livetable.js'

const DEGREES = 180 / Math.PI
// A signal that has not come for so long, while others did, is missing.
const MISSING_MS = 2000
const HEADING = 'Heading'
/** Names of the signal, title, unit, factor to it, decimals. @type {[string[], string, string, number, number][]} */
const TILES = [
  [['airspeed', 'V'], 'Airspeed', 'm/s', 1, 1], [['alpha'], 'α', '°', DEGREES, 1], [['beta'], 'β', '°', DEGREES, 1],
  [['phi'], 'Roll', '°', DEGREES, 0], [['theta'], 'Pitch', '°', DEGREES, 0], [['psi'], HEADING, '°', DEGREES, 0],
  [['height', 'altitude'], 'Height', 'm', 1, 0], [['thrust'], 'Thrust', 'N', 1, 1],
]
const PER_DEGREE = 2
const ROLL_MARKS = [-60, -45, -30, -20, -10, 0, 10, 20, 30, 45, 60]

class Tile {
  /** @param {[string[], string, string, number, number]} entry */
  constructor([names, title, unit, factor, decimals]) {
    this.names = names
    this.factor = factor
    this.decimals = decimals
    // From 0 to 359, as a compass has it.
    /** @type {(value: number) => number} */
    this.shown = title === HEADING ? value => (Math.round(value) + 360) % 360 : value => value
    this.figure = h('span', {}, NONE)
    this.words = h('span', { class: 'unseen' })
    this.old = h('span', { class: 'mark', hidden: true }, 'old')
    this.element = h('div', { class: 'tile' }, h('dt', {}, `${title}, ${unit} `, this.old),
      h('dd', {}, this.figure, ' ', this.words))
  }

  /**
   * known(name): its value, NaN where it is missing, undefined where it never came.
   * @param {(name: string) => number | undefined} known
   * @param {boolean} stale
   */
  show(known, stale) {
    // The first that ever came: another quantity does not take the place of one that is missing.
    const value = this.names.map(known).find(one => one !== undefined) ?? NaN
    const there = Number.isFinite(value)
    write(this.figure, there ? this.shown(value * this.factor).toFixed(this.decimals).replace(/^-(?=[0.]*$)/, '')
      .replace('-', '−') : NONE)
    write(this.words, there ? '' : 'not known', 'unseen')
    this.old.hidden = !(stale && there)
  }
}

/** A horizon and tiles with the newest values. */
export class Instruments {
  constructor() {
    this.tiles = TILES.map(entry => new Tile(entry))
    this.ground = svg('g', {}, svg('rect', { x: -300, y: 0, width: 600, height: 400, class: 'earth' }),
      svg('path', { d: 'M-300 0H300', class: 'skyline' }),
      [-20, -10, 10, 20].map(angle => [svg('path', { d: `M-18 ${-PER_DEGREE * angle}h36`, class: 'ladder' }),
        svg('text', { x: 21, y: -PER_DEGREE * angle + 3, class: 'rung' }, String(Math.abs(angle)))]))
    this.bank = svg('path', { d: 'M0 -49L-4 -42H4Z', class: 'pointer' })
    this.picture = svg('svg',
      { viewBox: '-100 -75 200 150', preserveAspectRatio: 'xMidYMid slice', role: 'img', class: 'horizon' },
      svg('rect', { x: -300, y: -400, width: 600, height: 800, class: 'sky' }), this.ground,
      ROLL_MARKS.map(angle => svg('path',
        { d: `M0 -56V${angle % 30 ? -53 : -50}`, transform: `rotate(${angle})`, class: 'ladder' })), this.bank,
      svg('path', { d: 'M-60 0h35l10 12M60 0h-35l-10 12M-3 0h6', class: 'aircraft' }),
      svg('path', { d: 'M-300 -225L300 225M-300 225L300 -225', class: 'cross' }))
    this.element = h('div', { class: 'instruments' }, this.picture,
      h('dl', { class: 'tiles' }, this.tiles.map(tile => tile.element)))
    this.elements = [h('h2', { class: 'unseen' }, 'Instruments'), this.element]
    this.old = true
    this.shown = 0
    /** @type {Map<string, { value: number, at: number }>} */
    this.known = new Map()
    this.clear()
  }

  /** Another flight: nothing is known of it. */
  clear() {
    this.known = new Map()
    this.draw(0)
  }

  /** Mark all figures as old ones, while nothing new comes, or as new ones. @param {boolean} is */
  stale(is) {
    if (is === this.old) return
    this.old = is
    this.draw(this.shown)
  }

  /**
   * Take the newest values by signal name, in SI.
   * @param {Record<string, number | null>} signals
   * @param {(name: string) => number} [age] how old a signal's is, s
   */
  show(signals, age = () => 0) {
    const now = Date.now()
    for (const [name, value] of Object.entries(signals)) {
      this.known.set(name, { value: value ?? NaN, at: now - 1000 * age(name) })
    }
    this.draw(now)
  }

  /** @param {number} now */
  draw(now) {
    this.shown = now
    /** @param {string} name */
    const known = name => {
      const found = this.known.get(name)
      return found && now - found.at > MISSING_MS ? NaN : found?.value
    }
    this.element.classList.toggle('stale', this.old)
    for (const tile of this.tiles) tile.show(known, this.old)
    this.horizon(known('phi') ?? NaN, known('theta') ?? NaN)
  }

  /** @param {number} phi @param {number} theta */
  horizon(phi, theta) {
    const there = Number.isFinite(phi) && Number.isFinite(theta)
    this.picture.classList.toggle('crossed', this.old || !there)
    if (!there) {
      this.picture.setAttribute('aria-label', 'Attitude: not known')
      return
    }
    const pitch = Math.max(-40, Math.min(40, theta * DEGREES))
    this.ground.setAttribute('transform',
      `rotate(${(-phi * DEGREES).toFixed(2)}) translate(0 ${(PER_DEGREE * pitch).toFixed(2)})`)
    this.bank.setAttribute('transform', `rotate(${(-phi * DEGREES).toFixed(2)})`)
    const [roll, nose] = [phi, theta].map(angle => number(Math.round(angle * DEGREES), 1))
    this.picture.setAttribute('aria-label',
      `${this.old ? 'Old attitude' : 'Attitude'}: roll ${roll}, pitch ${nose} degrees`)
  }
}
