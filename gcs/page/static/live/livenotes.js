// Notes made in flight, which stay in the recording, and what the vehicle says.

import { post, sentence } from '../shared/api.js'
import { announce } from '../shared/announce.js'
import { h } from '../shared/dom.js'
import { duration } from '../shared/format.js'

const SEVERITIES = ['emergency', 'alert', 'critical', 'error', 'warning', 'notice', 'info', 'debug']
const BAD = 4
const SHOWN = 6

/** Buttons, a field and the newest texts. */
export class Notes {
  /** @param {AbortSignal} signal */
  constructor(signal) {
    this.signal = signal
    /** @type {number | null} */
    this.time = null
    /** @type {LiveText[]} */
    this.own = []
    /** @type {LiveText[]} */
    this.heard = []
    const text = h('input', { type: 'text', maxlength: 200, autocomplete: 'off', 'aria-label': 'Note',
      'data-key': 'note', placeholder: 'What do you see?' })
    this.text = text
    this.form = h('form', { class: 'row note-form', submit: event => {
      event.preventDefault()
      if (text.value.trim()) this.note(text.value.trim(), () => { text.value = '' })
    } }, h('button', { type: 'button', class: 'main', 'data-key': 'mark', click: () => this.note('mark') }, 'Mark'),
    text, h('button', {}, 'Note'))
    this.list = h('ol', { class: 'said', 'aria-label': 'Texts and notes, the newest first' })
    this.element = h('section', { 'aria-labelledby': 'notes-heading' },
      h('h2', { id: 'notes-heading' }, 'Notes and texts'), this.form, this.list)
  }

  /** Another flight: nothing has been said in it. */
  clear() {
    this.own = []
    this.heard = []
    this.draw()
  }

  /** Take the texts of the vehicle; time: of the flight, s. @param {LiveText[]} texts */
  show(texts) {
    if (JSON.stringify(texts) === JSON.stringify(this.heard)) return
    const news = texts.filter(one =>
      (one.severity ?? Infinity) <= BAD && !this.heard.some(old => old.text === one.text && old.time_s === one.time_s))
    this.heard = texts
    if (news.length) announce(news.map(one => one.text).join('. '), true)
    this.draw()
  }

  /** @param {string} text @param {() => void} [done] */
  async note(text, done) {
    const time = this.time
    try {
      await post('/api/live/notes', { text })
      this.own.push({ time_s: time, text, note: true })
      done?.()
      this.draw()
    } catch (error) {
      if (!this.signal.aborted) announce(sentence(error), true)
    }
  }

  draw() {
    const every = [...this.heard, ...this.own].sort((a, b) => (b.time_s ?? 0) - (a.time_s ?? 0)).slice(0, SHOWN)
    this.list.replaceChildren(...every.map(one => h('li', {},
      h('span', { class: 'clock' }, one.time_s === null ? '' : duration(one.time_s)), ' ',
      h('span', { class: 'tag' }, one.note ? 'note' : SEVERITIES[one.severity ?? NaN] ?? 'text'), ' ',
      h('span', { translate: 'no' }, one.text))))
  }
}
