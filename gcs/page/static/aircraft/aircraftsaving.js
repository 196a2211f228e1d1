// The guided description of an aircraft: its form and its text kept alike, held against what flies, and saved.

import { post, sentence } from '../shared/api.js'
import { field, h, newId, remark } from '../shared/dom.js'
import { Form } from './aircraftform.js'
import { reading } from './aircraftreading.js'

const PAUSE_MS = 300

/**
 * @typedef {{ toml: string, form: AircraftForm | null, save: (draft: AircraftDraft) => Promise<void>, label: string,
 *   signal: AbortSignal }} Described
 */

/**
 * The form, what follows from it, and its text.
 * toml: the text that the form's answers are put into. form: null where the form cannot show it. save(draft): keeps it.
 * @param {Described} described
 */
export function aircraftForm({ toml, form, save, label, signal }) {
  return new Description(toml, form, save, label, signal).element
}

class Description {
  /**
   * @param {string} toml
   * @param {AircraftForm | null} form
   * @param {Described['save']} save
   * @param {string} label
   * @param {AbortSignal} signal
   */
  constructor(toml, form, save, label, signal) {
    this.toml = toml
    this.form = form && structuredClone(form)
    this.save = save
    this.signal = signal
    this.timer = 0
    this.asked = 0
    this.typed = false
    this.follows = h('section', { 'aria-label': 'Check', 'aria-live': 'polite' })
    this.words = h('p', { role: 'status' })
    this.button = h('button', { class: 'main' }, label)
    this.text = h('textarea', { rows: 18, spellcheck: false, class: 'code', input: () => this.changedText() })
    this.text.value = toml
    this.place = h('div', {})
    const whole = h('details', {}, h('summary', {}, 'The vehicle file itself'), field('Vehicle file (TOML)', this.text,
      'What the form does not ask (timing, gusts, further sensors) stands here; a change here shows in the form'))
    if (!form) whole.open = true
    this.element = h('form', { submit: event => this.submit(event), novalidate: true, class: 'description' },
      this.place, this.follows, whole, h('p', { class: 'row' }, this.button), this.words)
    this.draw()
    this.check()
  }

  draw() {
    if (!this.form) {
      this.place.replaceChildren(remark('note',
        h('p', {}, 'This file holds what the form cannot show; change its text.')))
      return
    }
    this.place.replaceChildren(...new Form(this.form, () => this.changed()).elements)
  }

  /** @returns {AircraftDraft} */
  draft() {
    const named = this.form && { ...this.form, name: this.form.name.trim() || 'aircraft' }
    return named && !this.typed ? { toml: this.toml, form: named } : { toml: this.text.value }
  }

  changed() {
    ++this.asked  // an answer that is still to come knows nothing of this
    clearTimeout(this.timer)
    this.timer = setTimeout(() => this.check(), PAUSE_MS)
  }

  changedText() {
    this.typed = true
    this.changed()
  }

  /** Ask what follows; a change of the text is shown in the form, one of the form in the text. */
  async check() {
    const draft = this.draft()
    const serial = ++this.asked
    /** @type {AircraftReading} */
    let found
    try {
      found = await post('/api/vehicles/check', draft)
    } catch (error) {
      if (serial === this.asked && !this.signal.aborted)
        this.follows.replaceChildren(remark('bad', h('p', {}, sentence(error))))
      return
    }
    if (serial !== this.asked || this.signal.aborted) return
    if (this.typed && !found.problem) {
      this.toml = found.toml
      this.form = found.form
      this.typed = false
      this.draw()
    } else if (!this.typed) {
      this.toml = found.toml
      this.text.value = found.toml
    }
    this.place.inert = this.typed  // what is changed in it meanwhile would be lost
    const begun = !this.form || Boolean(this.form.name || Object.keys(this.form.numbers).length)
    this.follows.replaceChildren(reading(found, begun),
      ...(this.typed ? [remark('note', h('p', {}, 'The form waits until the text is a vehicle file again.'))] : []))
  }

  /** @param {SubmitEvent} event */
  async submit(event) {
    event.preventDefault()
    if (this.form && !this.typed && !this.form.name.trim()) {
      this.words.className = 'remark bad'
      this.words.textContent = 'Give it a name.'
      return
    }
    this.words.className = ''
    this.words.textContent = 'Sent …'
    this.button.disabled = true
    try {
      await this.save(this.draft())
    } catch (error) {
      this.words.className = 'remark bad'
      this.words.textContent = sentence(error)
      this.words.id ||= newId('problem')
    } finally {
      this.button.disabled = false
    }
  }
}
