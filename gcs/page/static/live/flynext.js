// What to fly next, as one card: the manoeuvre that most of what is still unknown asks for, read aloud on request.

import { h } from '../shared/dom.js'
import { keep, kept } from '../shared/kept.js'
import { language, say } from '../shared/language.js'
import { write } from './livetable.js'

const SPEAK = 'speak-next'
/** @type {Record<string, string>} */
const SHAPES = { multisine: 'a multisine of 20 s', 3211: 'a 3-2-1-1', doublet: 'doublets', step: 'steps',
  pulse: 'a pulse' }
// What each shape takes on one surface, s, with the rest behind it; the other manoeuvres as a whole.
/** @type {Record<string, number>} */
const LASTS_S = { multisine: 20, 3211: 6, doublet: 4, step: 4, pulse: 3 }
const OTHERS_S = 20
const LEAD_S = 3
const BY_HAND = 'By hand: half a second one way, half a second the other, let go for three seconds; five times on each '
  + 'surface, by 2 to 4°.'
// Surfaces as they are measured, and what each must move at least to show anything, rms.
/** @type {Record<string, string>} */
const MEASURED = { elevator: 'de', aileron: 'da', rudder: 'dr' }
const LEAST_DEG = 1
// So long what was flown stands there, then what to fly next.
const VERDICT_MS = 15_000
// Readings of a surface that moved, fewer than which say nothing.
const FEWEST = 5
/** @type {Record<string, string>} */
const SURFACES = { elevator: 'elevator', aileron: 'ailerons', rudder: 'rudder', throttle: 'throttle' }

/**
 * A manoeuvre as one says it: "elevator-3211,aileron-doublet" is "a 3-2-1-1 on the elevator, doublets on the ailerons".
 * @param {string} manoeuvre
 */
export function spoken(manoeuvre) {
  if (manoeuvre === 'roller-coaster') return 'a roller-coaster: pull up and push over, gently, a few times'
  /** @type {Map<string, string[]>} */
  const parts = new Map()
  for (const piece of manoeuvre.split(',')) {
    const [, surface, shape] = /^(\w+)-(\w+)$/.exec(piece.trim()) ?? []
    if (!surface || !(shape in SHAPES)) return manoeuvre
    parts.set(shape, [...(parts.get(shape) ?? []), SURFACES[surface] ?? surface.replaceAll('_', ' ')])
  }
  return [...parts].map(([shape, surfaces]) => `${SHAPES[shape]} on the ${listed(surfaces)}`).join(', ')
}

/** Seconds that a manoeuvre takes, and the surfaces that it moves. @param {string} manoeuvre */
export function course(manoeuvre) {
  const parts = manoeuvre.split(',').map(piece => /^(\w+)-(\w+)$/.exec(piece.trim()) ?? [])
  const known = parts.every(([, surface, shape]) => surface in SURFACES && shape in LASTS_S)
  if (!known) return { seconds: OTHERS_S, surfaces: [] }
  // Sines on several surfaces are flown at once.
  const lengths = parts.map(([, , shape]) => LASTS_S[shape])
  const sines = parts.filter(([, , shape]) => shape === 'multisine').length
  const seconds = lengths.reduce((sum, one) => sum + one, 0) - Math.max(sines - 1, 0) * LASTS_S.multisine
  return { seconds, surfaces: parts.map(([, surface]) => surface).filter(surface => surface in MEASURED) }
}

/** @param {string[]} words */
const listed = words => words.length < 2 ? words.join('') : `${words.slice(0, -1).join(', ')} and ${words.at(-1)}`

/** @param {string} text */
const upper = text => text.charAt(0).toUpperCase() + text.slice(1)

/** The card. */
export class FlyNext {
  constructor() {
    this.what = h('p', { class: 'next-what' })
    this.why = h('p', { class: 'hint' })
    this.hand = h('p', { class: 'hint' })
    this.speaks = kept(SPEAK) === 'yes'
    this.voice = h('button', { type: 'button', class: 'small', 'data-key': 'speak',
      'aria-pressed': String(this.speaks), click: () => this.toggle() }, 'Read aloud')
    this.voice.hidden = !('speechSynthesis' in window)
    this.count = h('p', { class: 'next-count', hidden: true })
    /** @type {Record<string, number[]>} angles that were received, by surface */
    this.moved = {}
    this.counts = h('button', { type: 'button', class: 'small', 'data-key': 'count',
      click: () => this.counting ? this.end() : this.begin() }, 'Count down')
    this.wanted = ''
    this.displayed = ''
    this.counting = undefined
    this.element = h('section', { class: 'card next', hidden: true, 'aria-labelledby': 'next-heading' },
      h('div', { class: 'row' }, h('h2', { id: 'next-heading' }, 'Fly next'), this.counts, this.voice), this.what,
      this.count, this.why, this.hand)
    this.said = ''
  }

  clear() {
    this.element.hidden = true
    this.said = ''
    this.end()
  }

  /**
   * Take the coefficients of the live estimate, null where there are none.
   * @param {Record<string, LiveCoefficient> | null} [coefficients]
   */
  show(coefficients) {
    const entries = Object.entries(coefficients ?? {})
    this.element.hidden = !entries.length
    if (!entries.length) return
    /** @type {Map<string, string[]>} */
    const wanted = new Map()
    for (const [name, entry] of entries) {
      if (!entry.known && entry.fly) wanted.set(entry.fly, [...(wanted.get(entry.fly) ?? []), name])
    }
    if (this.counting) return  // what is being flown stays until it is over
    const [best] = [...wanted].sort((a, b) => b[1].length - a[1].length)
    const begun = entries.some(([, entry]) => entry.known)
    this.element.classList.toggle('flown', !best && begun)
    this.wanted = best?.[0] ?? ''
    this.counts.hidden = !best
    const text = best ? upper(spoken(best[0])) : begun ? '✓ Everything that this flight should identify is known.'
      : 'Nothing is known yet. The first estimate comes after some seconds in the air.'
    write(this.what, text, 'next-what')
    write(this.why, best ? `It would identify ${best[1].join(', ')}.` : '', 'hint')
    write(this.hand, best?.[0].includes('multisine') ? BY_HAND : '', 'hint')
    if (text !== this.said) {
      this.said = text
      this.say(text)
    }
  }

  /** Count down, then while the manoeuvre is flown; in the end say whether the surfaces moved. */
  begin() {
    this.stop()
    const { seconds, surfaces } = course(this.wanted)
    const start = performance.now() + 1000 * LEAD_S
    this.moved = Object.fromEntries(surfaces.map(surface => [surface, []]))
    this.counting = setInterval(() => this.tick(start, seconds), 250)
    write(this.counts, 'Stop', 'small')
    this.tick(start, seconds)
  }

  /** @param {number} start @param {number} seconds */
  tick(start, seconds) {
    const passed = (performance.now() - start) / 1000
    this.flying = passed >= 0
    this.count.hidden = false
    if (passed < 0) this.display(`Begins in ${Math.ceil(-passed)}`)
    else if (passed < seconds) this.display(`Fly now: ${Math.ceil(seconds - passed)} s left`, Math.floor(passed) === 0)
    else {
      this.stop()
      this.display(this.verdict())
      this.leaving = setTimeout(() => this.end(), VERDICT_MS)
    }
  }

  /** Show a line, and say it where that is wanted; seconds that are left are not said. @param {string} text */
  display(text, aloud = !text.startsWith('Fly now')) {
    if (text !== this.displayed) {
      this.displayed = text
      write(this.count, text, 'next-count')
      if (aloud) this.say(text.replace(/: \d+ s left/, ''))
    }
  }

  /** What the surfaces have done, in words. */
  verdict() {
    const figures = []
    for (const [surface, angles] of Object.entries(this.moved)) {
      if (angles.length < FEWEST) return `What the ${SURFACES[surface]} did was not received.`
      const mean = angles.reduce((sum, one) => sum + one, 0) / (angles.length || 1)
      const squares = angles.reduce((sum, one) => sum + (one - mean) ** 2, 0)
      const rms = Math.sqrt(squares / (angles.length || 1)) * 180 / Math.PI
      if (rms < LEAST_DEG)
        return `The ${SURFACES[surface]} hardly moved (${rms.toFixed(1)}° rms): fly it again, larger.`
      figures.push(`the ${SURFACES[surface]}${figures.length ? '' : ' moved'} by `
        + `${rms.toFixed(1)}°${figures.length ? '' : ' rms'}`)
    }
    return figures.length ? `✓ Flown: ${figures.join(', ')}.` : '✓ Flown.'
  }

  /** Take the newest signals: name -> value. @param {Record<string, number | null>} signals */
  feel(signals) {
    if (!this.counting || !this.flying) return
    for (const [surface, angles] of Object.entries(this.moved)) {
      const angle = signals[MEASURED[surface]]
      // The newest value comes again and again, however old it is.
      if (angle !== null && Number.isFinite(angle) && angle !== angles.at(-1)) angles.push(angle)
    }
  }

  /** Stop before its end: nothing is left on the screen of it. */
  end() {
    this.stop()
    this.count.hidden = true
    this.displayed = ''
  }

  stop() {
    clearInterval(this.counting)
    clearTimeout(this.leaving)
    this.counting = undefined
    write(this.counts, 'Count down', 'small')
  }

  toggle() {
    this.speaks = !this.speaks
    keep(SPEAK, this.speaks ? 'yes' : 'no')
    this.voice.setAttribute('aria-pressed', String(this.speaks))
    if (this.speaks) this.say(this.said)
    else speechSynthesis.cancel()
  }

  /** @param {string} text */
  say(text) {
    if (!this.speaks || !text) return
    speechSynthesis.cancel()
    const words = new SpeechSynthesisUtterance(say(text).replace('✓ ', ''))
    words.lang = language()
    speechSynthesis.speak(words)
  }
}
