// Where the aircraft has been, over ground: home, wind, a scale, the aircraft. No map is needed, and none is fetched
// from
// elsewhere; one that the station has lies beneath.

import { h, svg } from '../shared/dom.js'
import { number } from '../shared/format.js'
import { write } from './livetable.js'
import { MapTiles } from './maptiles.js'

const SIZE = 300
const MARGIN = 26
const LEAST_M = 120
const MOST = 2000
const METRES_PER_DEGREE = 6_378_137 * Math.PI / 180
const STEPS = [20, 50, 100, 200, 500, 1000, 2000, 5000, 10000]

/** The track. */
export class Track {
  /** @param {AbortSignal} signal */
  constructor(signal) {
    /** @type {Point[]} */
    this.places = []
    /** @type {number | null} */
    this.heading = null
    /** @type {number | undefined} over ground, m/s */
    this.speed = undefined
    /** @type {Point | undefined} home, as latitude and longitude */
    this.from = undefined
    this.map = new MapTiles()
    this.map.ask(signal).then(() => this.draw())
    this.credit = h('small', {})
    this.path = svg('path', { class: 'track' })
    this.home = svg('path', { d: 'M-7 0H7M0 -7V7', class: 'home' })
    this.craft = svg('path', { d: 'M0 -11L7 9L0 4L-7 9Z', class: 'craft', visibility: 'hidden' })
    this.bar = svg('path', { class: 'scale' })
    this.barText = svg('text', { x: 12, y: SIZE - 16 })
    this.wind = svg('g', { visibility: 'hidden' }, svg('path', { d: 'M0 -14V12M-5 5L0 14L5 5', class: 'wind' }))
    this.windText = svg('text', { x: SIZE - 12, y: 52, 'text-anchor': 'end' })
    this.picture = svg('svg',
      { viewBox: `0 0 ${SIZE} ${SIZE}`, role: 'img', class: 'map', 'aria-label': 'Track over ground: no position yet' },
      svg('rect', { width: SIZE, height: SIZE, class: 'ground' }), this.map.element,
      svg('text', { x: SIZE / 2, y: 16, 'text-anchor': 'middle' }, 'N'),
      this.path, this.home, this.craft, this.bar, this.barText, this.wind, this.windText)
    this.words = h('span', {}, 'No position yet.')
    this.over = h('span', {})
    this.element = h('figure', { class: 'ground-track', hidden: true }, this.picture,
      h('figcaption', {}, this.words, ' ', this.over), this.credit)
    this.clear()
  }

  /** Another flight: it has been nowhere. */
  clear() {
    this.places = []
    this.heading = null
    this.speed = undefined
    this.element.hidden = true
  }

  /** Begin with where it has been, m north and east of home. @param {Point[]} track @param {Point} [home] */
  fill(track, home) {
    this.places = track.slice()
    this.from = home
    this.draw()
  }

  /** Take the status of the vehicle. @param {VehicleStatus} status */
  show(status) {
    if (status.wind) this.blow(status.wind)
    if (!status.position) return
    this.given = status.home?.given
    this.speed = status.ground_speed
    this.move(status.home?.place)
    const last = this.places.at(-1)
    const [north, east] = status.position
    if (!last || Math.hypot(north - last[0], east - last[1]) >= 1) {
      if (last) this.heading = Math.atan2(east - last[1], north - last[0])
      this.places.push([north, east])
    }
    if (this.places.length > MOST) this.places = this.places.filter((_, at) => at % 2 === (this.places.length - 1) % 2)
    this.draw()
  }

  /** Home is another place than before: what lies behind stays where it was over ground. @param {Point} [home] */
  move(home) {
    const before = this.from
    this.from = home ?? before
    if (!before || !home || (before[0] === home[0] && before[1] === home[1])) return
    const north = (before[0] - home[0]) * METRES_PER_DEGREE
    const east = (before[1] - home[1]) * METRES_PER_DEGREE * Math.cos(home[0] * Math.PI / 180)
    this.places = this.places.map(one => [one[0] + north, one[1] + east])
  }

  draw() {
    if (!this.places.length) return
    this.element.hidden = false
    const all = [[0, 0], ...this.places]
    const [norths, easts] = [0, 1].map(at => all.map(one => one[at]))
    const [low, high] = [[Math.min(...norths), Math.min(...easts)], [Math.max(...norths), Math.max(...easts)]]
    const span = Math.max(high[0] - low[0], high[1] - low[1], LEAST_M)
    const scale = (SIZE - 2 * MARGIN) / span
    const middle = [0, 1].map(at => (low[at] + high[at]) / 2)
    /** @param {Point} place @returns {Point} */
    const at = ([north, east]) => [SIZE / 2 + (east - middle[1]) * scale, SIZE / 2 - (north - middle[0]) * scale]
    this.map.draw(this.from, middle, SIZE / 2 / scale, scale, at)
    write(this.credit, this.map.map?.attribution ?? '')
    /** @param {Point} place */
    const move = place => `translate(${at(place).map(one => one.toFixed(1)).join(' ')})`
    this.path.setAttribute('d',
      `M${this.places.map(one => at(one).map(value => value.toFixed(1)).join(' ')).join('L')}`)
    this.home.setAttribute('transform', move([0, 0]))
    const here = this.places[this.places.length - 1]
    this.craft.setAttribute('visibility', this.heading === null ? 'hidden' : 'visible')
    this.craft.setAttribute('transform', `${move(here)} rotate(${((this.heading ?? 0) * 180 / Math.PI).toFixed(0)})`)
    const step = STEPS.findLast(one => one * scale <= SIZE / 3) ?? STEPS[0]
    this.bar.setAttribute('d', `M12 ${SIZE - 10}h${(step * scale).toFixed(1)}m0 -4v8M12 ${SIZE - 14}v8`)
    this.barText.textContent = step < 1000 ? `${step} m` : `${step / 1000} km`
    this.say(here)
  }

  /** @param {Point} place */
  say([north, east]) {
    const away = Math.hypot(north, east)
    const bearing = Math.round((Math.atan2(-east, -north) * 180 / Math.PI + 360) % 360)
    const from = this.given ? 'home' : 'where it was heard first'
    const text = away < 5 ? `At ${from}.` : `${number(away, 2)} m from ${from}, which lies at ${bearing}°.`
    const speed = this.speed ?? NaN
    write(this.over, Number.isFinite(speed) ? `${speed.toFixed(0)} m/s over ground.` : '')
    write(this.words, text)
    this.picture.setAttribute('aria-label', `Track over ground. ${text}`)
  }

  /** @param {Wind} wind */
  blow({ north, east }) {
    const speed = Math.hypot(north, east)
    this.wind.setAttribute('visibility', speed > 0.3 ? 'visible' : 'hidden')
    // The arrow points downwards at 0: where the air goes.
    this.wind.setAttribute('transform',
      `translate(${SIZE - 22} 24) rotate(${(Math.atan2(east, north) * 180 / Math.PI + 180).toFixed(0)})`)
    this.windText.textContent = speed > 0.3 ? `${speed.toFixed(1)} m/s` : ''
  }
}
