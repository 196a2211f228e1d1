// A map beneath the track, from a file that the station was given; nothing is fetched from elsewhere.

import { get, request } from '../shared/api.js'
import { svg } from '../shared/dom.js'

const EQUATOR_M = 2 * Math.PI * 6_378_137
const METRES_PER_DEGREE = EQUATOR_M / 360
const TILE_PX = 256
// Pictures are taken so much finer than the drawing's own units, since screens are.
const FINER = 2
const MOST_TILES = 48
const MOST_KEPT = 300

/**
 * Column and row of a place in the tiles of a zoom, Web Mercator (EPSG:3857), as fractions.
 * @param {number[]} place
 * @param {number} zoom
 */
export function tileOf([latitude, longitude], zoom) {
  const count = 2 ** zoom
  return [(longitude + 180) / 360 * count, (1 - Math.asinh(Math.tan(latitude * Math.PI / 180)) / Math.PI) / 2 * count]
}

/**
 * Latitude and longitude of a corner between tiles.
 * @param {number[]} corner @returns {[number, number]}
 * @param {number} zoom
 */
export function placeOf([column, row], zoom) {
  const count = 2 ** zoom
  return [Math.atan(Math.sinh(Math.PI * (1 - 2 * row / count))) * 180 / Math.PI, column / count * 360 - 180]
}

/** The tiles. */
export class MapTiles {
  constructor() {
    this.element = svg('g', { class: 'tiles', 'aria-hidden': 'true' })
    /** @type {Map<string, SVGImageElement>} */
    this.shown = new Map()
    /** @type {Map<string, Promise<string | null>>} */
    this.pictures = new Map()
    /** @type {StationMap | null} */
    this.map = null
  }

  /** Ask whether the station has a map; without one nothing is drawn. @param {AbortSignal} signal */
  async ask(signal) {
    try {
      this.map = (await get('/api/map', signal)).map
      signal.addEventListener('abort', () => this.close())
    } catch {
      this.map = null
    }
  }

  /**
   * Draw what lies around. home: latitude, longitude; at: from m north and east of it to the drawing; reach: m from the
   * middle.
   * @param {Point | null | undefined} home
   * @param {number[]} middle
   * @param {number} reach
   * @param {number} scale
   * @param {(place: Point) => Point} at
   */
  draw(home, middle, reach, scale, at) {
    if (!this.map || !home) return
    const cosine = Math.cos(home[0] * Math.PI / 180)
    /** @param {number} north @param {number} east @returns {Point} */
    const place = (north, east) => [home[0] + north / METRES_PER_DEGREE, home[1] + east / METRES_PER_DEGREE / cosine]
    /** @param {Point} place @returns {Point} */
    const metres = ([latitude, longitude]) =>
      [(latitude - home[0]) * METRES_PER_DEGREE, (longitude - home[1]) * METRES_PER_DEGREE * cosine]
    const wanted = Math.ceil(Math.log2(EQUATOR_M * cosine * scale * FINER / TILE_PX))
    let zoom = Math.min(Math.max(wanted, this.map.least_zoom), this.map.most_zoom)
    let range = around(place, middle, reach, zoom)
    while (range.count > MOST_TILES && zoom > this.map.least_zoom) range = around(place, middle, reach, --zoom)
    const wantedKeys = new Set()
    for (let column = range.columns[0]; column <= range.columns[1] && range.count <= MOST_TILES; column++) {
      for (let row = range.rows[0]; row <= range.rows[1]; row++) {
        const key = `${zoom}/${column}/${row}`
        wantedKeys.add(key)
        const [left, top] = at(metres(placeOf([column, row], zoom)))
        const [right, bottom] = at(metres(placeOf([column + 1, row + 1], zoom)))
        this.put(key, left, top, right - left, bottom - top)
      }
    }
    for (const [key, image] of this.shown) {
      if (wantedKeys.has(key)) continue
      image.remove()
      this.shown.delete(key)
    }
  }

  /** @param {string} key @param {number} x @param {number} y @param {number} width @param {number} height */
  put(key, x, y, width, height) {
    const known = this.shown.get(key)
    const image = known ?? svg('image', { preserveAspectRatio: 'none' })
    if (!known) {
      this.shown.set(key, image)
      this.element.append(image)
      this.picture(key).then(address =>
        address ? image.setAttribute('href', address) : this.shown.delete(key) && image.remove())
    }
    // A hair larger, so that no seam shows.
    for (const [name, value] of Object.entries({ x, y, width: width + 0.3,
      height: height + 0.3 })) image.setAttribute(name, value.toFixed(2))
  }

  /** The address of a tile's picture. @param {string} key */
  picture(key) {
    const kept = this.pictures.get(key)
    if (kept) return kept
    const fetched = request(`/api/map/${key}`).then(answer => answer.blob()).then(blob => URL.createObjectURL(blob))
      .catch(error => {
        // A tile that the file lacks is asked for once; one that was lost under way again.
        if (error.status !== 404) this.pictures.delete(key)
        return null
      })
    this.pictures.set(key, fetched)
    if (this.pictures.size > MOST_KEPT) this.forget()
    return fetched
  }

  /** The view is left: no picture is kept. */
  close() {
    for (const kept of this.pictures.values()) kept.then(address => address && URL.revokeObjectURL(address))
    this.pictures.clear()
  }

  forget() {
    const [oldest] = [...this.pictures.keys()].filter(key => !this.shown.has(key))
    if (oldest === undefined) return
    this.pictures.get(oldest)?.then(address => address && URL.revokeObjectURL(address))
    this.pictures.delete(oldest)
  }
}

/**
 * Columns and rows that are seen, and how many tiles these are.
 * @param {(north: number, east: number) => Point} place
 * @param {number[]} middle
 * @param {number} reach
 * @param {number} zoom
 */
function around(place, middle, reach, zoom) {
  const [left, top] = tileOf(place(middle[0] + reach, middle[1] - reach), zoom)
  const [right, bottom] = tileOf(place(middle[0] - reach, middle[1] + reach), zoom)
  const columns = [Math.floor(left), Math.floor(right)]
  const rows = [Math.max(Math.floor(top), 0), Math.min(Math.floor(bottom), 2 ** zoom - 1)]
  return { columns, rows, count: (columns[1] - columns[0] + 1) * (rows[1] - rows[0] + 1) }
}
