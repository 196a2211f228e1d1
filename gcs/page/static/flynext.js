// What to fly next, as one card: the manoeuvre that most of what is still unknown asks for, read aloud on request.

import { h } from './dom.js'
import { keep, kept } from './kept.js'
import { write } from './livetable.js'

const SPEAK = 'speak-next'
const SHAPES = { multisine: 'a multisine of 20 s', 3211: 'a 3-2-1-1', doublet: 'doublets', step: 'steps', pulse: 'a pulse' }
const SURFACES = { elevator: 'elevator', aileron: 'ailerons', rudder: 'rudder', throttle: 'throttle' }

/** A manoeuvre as one says it: "elevator-3211,aileron-doublet" is "a 3-2-1-1 on the elevator, doublets on the ailerons". */
export function spoken(manoeuvre) {
  if (manoeuvre === 'roller-coaster') return 'a roller-coaster: pull up and push over, gently, a few times'
  const parts = new Map()
  for (const piece of manoeuvre.split(',')) {
    const [, surface, shape] = /^(\w+)-(\w+)$/.exec(piece.trim()) ?? []
    if (!(surface in SURFACES) || !(shape in SHAPES)) return manoeuvre
    parts.set(shape, [...(parts.get(shape) ?? []), SURFACES[surface]])
  }
  return [...parts].map(([shape, surfaces]) => `${SHAPES[shape]} on the ${listed(surfaces)}`).join(', ')
}

const listed = words => words.length < 2 ? words.join('') : `${words.slice(0, -1).join(', ')} and ${words.at(-1)}`

const upper = text => text.charAt(0).toUpperCase() + text.slice(1)

/** The card. */
export class FlyNext {
  constructor() {
    this.what = h('p', { class: 'next-what' })
    this.why = h('p', { class: 'hint' })
    this.speaks = kept(SPEAK) === 'yes'
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
    const text = best ? upper(spoken(best[0])) : '✓ Everything that this flight should identify is known.'
    write(this.what, text, 'next-what')
    write(this.why, best ? `It would identify ${best[1].join(', ')}.` : '', 'hint')
    if (text !== this.said) {
      this.said = text
      this.say(text)
    }
  }

  toggle() {
    this.speaks = !this.speaks
    keep(SPEAK, this.speaks ? 'yes' : 'no')
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
