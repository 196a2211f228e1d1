// Signals of a flight: which, how they are drawn, and of which stretch; the address keeps all three.

import { announce } from '../shared/announce.js'
import { Drawing } from './drawing.js'
import { field, h, remark, select, table } from '../shared/dom.js'
import { signalName } from '../shared/format.js'
import { layouts } from './layouts.js'
import { keepQuery } from '../shared/router.js'

const USUAL = ['airspeed', 'alpha', 'beta', 'q', 'de']
const SEVERITIES = ['emergency', 'alert', 'critical', 'error', 'warning', 'notice', 'info', 'debug']
/** @type {Choice[]} */
const WAYS = [['', 'each in a plot of its own'], ['together', 'those of one unit together'],
  ['xy', 'against the first one'], ['spectrum', 'as spectra'], ['spectrogram', 'as spectra over time']]
/** In the address: between plots, and between the signals of one plot. */
const [NEXT_PLOT, SAME_PLOT] = [',', '~']

/**
 * The section of signals of a flight. begun: called with a job that was started for the stretch that is shown.
 * @param {HTMLElement} page
 * @param {FlightSummary} summary
 * @param {URLSearchParams} query
 * @param {AbortSignal} signal
 * @param {TakeJob} begun
 */
export async function signals(page, summary, query, signal, begun) {
  page.append(h('h2', {}, 'Signals'))
  if (!summary.signals.length) {
    page.append(remark('note', h('p', {}, summary.state === 'recording'
      ? 'The flight is still being recorded; its signals stand here when it is over. Until then see the live page.'
      : 'No signal can be read from this recording; the warnings above say why.')))
    return
  }
  const fields = new Set(Object.entries(summary.fields).flatMap(([message, names]) =>
    names.map(name => `${message}.${name}`)))
  /** @param {string} name */
  const known = name => summary.signals.includes(name) || fields.has(name)
  /** The signals of each plot. */
  let groups = query.has('signals')
    ? (query.get('signals') ?? '').split(NEXT_PLOT).map(text => text.split(SAME_PLOT).filter(known))
    : USUAL.filter(known).map(name => [name])
  groups = groups.filter(group => group.length)
  if (!groups.length) groups = [[summary.signals[0]]]
  /** @param {string[][]} changed @returns {Promise<void>} */
  const regroup = changed => {
    groups = changed.filter(group => group.length)
    query.set('signals', groups.map(group => group.join(SAME_PLOT)).join(NEXT_PLOT))
    keepQuery(query)
    return again()
  }
  const drawing = new Drawing(summary, query, signal, begun, regroup)
  const again = () => drawing.draw(groups).catch(error => {
    if (!signal.aborted) announce(error.message, true)
  })
  /** @param {string} name */
  const box = name => h('label', { class: 'choice' }, h('input', {
    type: 'checkbox', checked: groups.flat().includes(name), change: event => regroup(event.target.checked
      ? [...groups, [name]] : groups.map(group => group.filter(one => one !== name))),
  }), signalName(name))
  const way = select(WAYS, query.get('as') ?? '', value => {
    query.set('as', value)
    keepQuery(query)
    again()
  })
  way.setAttribute('aria-label', 'How they are drawn')
  page.append(
    h('details', { class: 'panel' }, h('summary', {}, 'Choose signals'),
      h('fieldset', { class: 'choices' }, h('legend', {}, 'Signals to plot'), summary.signals.map(box)),
      anyField(summary.fields, groups.flat(), box)),
    h('div', { class: 'row' }, h('label', {}, 'Drawn ', way), layouts(query)),
    drawing.controls(), drawing.shaded,
    h('div', {}, drawing.cursor.element, drawing.place), events(summary, drawing))
  await again()
}

/**
 * Any number of any message as it was sent: a message is chosen first.
 * @param {Record<string, string[]>} messages
 * @param {string[]} chosen
 * @param {(name: string) => HTMLElement} box
 */
function anyField(messages, chosen, box) {
  const names = Object.keys(messages)
  if (!names.length) return ''
  const list = h('fieldset', { class: 'choices' })
  /** @param {string} message */
  const show = message => list.replaceChildren(h('legend', {}, `Fields of ${message}, as they were sent`),
    ...messages[message].map(name => box(`${message}.${name}`)))
  const first = chosen.map(name => name.split('.')[0]).find(name => name in messages) ?? names[0]
  show(first)
  return h('div', {}, field('Any field of a message', select(names.map(name => [name, name]), first, show)), list)
}

/**
 * Modes of the autopilot and what the vehicle said; each leads the cursor there.
 * @param {FlightSummary} summary
 * @param {Drawing} drawing
 */
function events({ modes, texts }, drawing) {
  const rows = [
    ...modes.map(one => ({ time: one.start, what: `${one.mode}${one.armed ? '' : ', disarmed'}`, kind: 'mode' })),
    ...texts.map(one =>
      ({ time: one.time, what: one.text, kind: one.note ? 'note' : SEVERITIES[one.severity] ?? 'text' })),
  ].sort((a, b) => a.time - b.time)
  if (!rows.length) return ''
  const found = table('What happened', ['Time, s', 'What', 'Kind'], rows.map(({ time, what, kind }) => [
    h('button', { type: 'button', class: 'small', 'aria-label': `Put the cursor to ${time.toFixed(1)} s`,
      click: () => drawing.cursor.move(time) }, time.toFixed(1)), what, kind]))
  return h('details', {}, h('summary', {}, `Modes and texts (${rows.length})`), found)
}
