// Warnings and changes of the model. Their figures move from estimate to estimate; what they say is announced once.

import { announce } from '../shared/announce.js'
import { h, remark } from '../shared/dom.js'
import { write } from './livetable.js'

// A warning that comes back after so long is news again.
const FORGOTTEN_MS = 60_000
// Figures, not those that belong to a name, as in adc1.
const FIGURES = /(?<![\p{L}\d_])[-+]?\d+(\.\d+)?/gu

export class Warnings {
  constructor() {
    this.element = h('div', {})
    /** @type {Map<string, number>} when each was there last */
    this.heard = new Map()
    /** @type {HTMLElement[]} */
    this.lines = []
    this.keys = ''
    this.clear()
  }

  /** Another flight: all is news. */
  clear() {
    this.heard = new Map()
    this.show([], [])
  }

  /** Take changes of the model and warnings, as sentences. @param {string[]} changes @param {string[]} warnings */
  show(changes, warnings) {
    // A second change of a coefficient is another one, though only its figures differ.
    const found = [...changes.map(text => ({ kind: 'bad', text, key: text })),
      ...warnings.map(text => ({ kind: 'note', text, key: text.replace(FIGURES, '0') }))]
    const keys = JSON.stringify(found.map(one => one.key))
    if (keys !== this.keys) {
      this.keys = keys
      this.lines = found.map(() => h('p', {}))
      this.element.replaceChildren(...found.map(({ kind }, at) => remark(kind, this.lines[at])))
    }
    found.forEach(({ text }, at) => write(this.lines[at], text))
    this.announceNew(found)
  }

  /** @param {{ key: string, text: string }[]} found */
  announceNew(found) {
    const now = Date.now()
    const news = found.filter(({ key }) => !(now - (this.heard.get(key) ?? -Infinity) < FORGOTTEN_MS))
    for (const { key } of found) this.heard.set(key, now)
    if (news.length) announce(news.map(one => one.text).join('. '))
  }
}
