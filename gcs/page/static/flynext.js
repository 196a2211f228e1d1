// What to fly next, as one card: the manoeuvre that most of what is still unknown asks for, read aloud on request.

import { h } from './dom.js'
import { write } from './livetable.js'

const SPEAK = 'speak-next'

/** The card. */
export class FlyNext {
  constructor() {
    this.what = h('p', { class: 'next-what' })
    this.why = h('p', { class: 'hint' })
    this.speaks = localStorage.getItem(SPEAK) === 'yes'
    this.voice = h('button', { type: 'button', class: 'small', 'aria-pressed': String(this.speaks), click: () => this.toggle() }, 'Read aloud')
    this.voice.hidden = !('speechSynthesis' in window)
    this.element = h('section', { class: 'card next', hidden: true, 'aria-labelledby': 'next-heading' },
      h('div', { class: 'row' }, h('h2', { id: 'next-heading' }, 'Fly next'), this.voice), this.what, this.why)
    this.said = ''
  }

  clear() {
    this.element.hidden = true
    this.said = ''
  }

  /** Take the coefficients of the live estimate, null where there are none. */
  show(coefficients) {
    const entries = Object.entries(coefficients ?? {})
    this.element.hidden = !entries.length
    if (!entries.length) return
    const wanted = new Map()
    for (const [name, entry] of entries) {
      if (!entry.known && entry.fly) wanted.set(entry.fly, [...(wanted.get(entry.fly) ?? []), name])
    }
    const [best] = [...wanted].sort((a, b) => b[1].length - a[1].length)
    this.element.classList.toggle('flown', !best)
    const text = best ? best[0] : '✓ All that this flight is asked for is known.'
    write(this.what, text, 'next-what')
    write(this.why, best ? `It would identify ${best[1].join(', ')}.` : '', 'hint')
    if (text !== this.said) {
      this.said = text
      this.say(text)
    }
  }

  toggle() {
    this.speaks = !this.speaks
    localStorage.setItem(SPEAK, this.speaks ? 'yes' : 'no')
    this.voice.setAttribute('aria-pressed', String(this.speaks))
    if (this.speaks) this.say(this.said)
    else speechSynthesis.cancel()
  }

  say(text) {
    if (!this.speaks || !text) return
    speechSynthesis.cancel()
    speechSynthesis.speak(new SpeechSynthesisUtterance(text.replace('✓ ', '')))
  }
}
