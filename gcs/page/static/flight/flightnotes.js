// What people say of a flight: its name, a comment, tags, and which aircraft it was.

import { get, patch, sentence } from '../shared/api.js'
import { field, h, remark, select } from '../shared/dom.js'

/** @type {Record<string, [string, string]>} */
const VERDICTS = { good: ['good', 'good for identification'], care: ['note', 'usable with care'],
  poor: ['bad', 'too poor'] }

/**
 * The verdict of the newest identification, or how far it is, in one line; nothing where there is neither.
 * @param {Flight} flight
 */
export function outcomeLine({ outcome }) {
  const { state, verdict, text } = outcome
  if (state === 'queued' || state === 'running') return remark('note', h('p', {}, 'Identification is at work.'))
  if (verdict) {
    const [kind, words] = VERDICTS[verdict]
    return remark(kind, h('p', {}, h('strong', {}, words), text && verdict !== 'good' ? `: ${text}` : ''))
  }
  if (state === 'failed') return remark('bad', h('p', {}, h('strong', {}, 'No model: '), text))
  return null
}

/** A few words on it for a list. @param {Flight} flight */
export function outcomeWords({ outcome, state, recording_deleted }) {
  if (state === 'recording') return 'being recorded'
  if (outcome.state === 'queued') return 'waits to be identified'
  if (outcome.state === 'running') return 'is being identified'
  const verdict = VERDICTS[outcome.verdict ?? '']?.[1]
  const made = verdict ? `model ${verdict}`
    : outcome.state === 'failed' ? 'no model could be made'
      : outcome.state === 'skipped' ? 'nothing airborne in it' : 'not identified yet'
  return [made, state === 'recovered' && 'recovered after a crash',
    recording_deleted && 'recording deleted to make room'].filter(Boolean).join('; ')
}

/**
 * Name, comment, tags and aircraft of a flight, each kept as soon as it is changed. done: called when one was.
 * @param {FlightSummary} summary
 * @param {string} path
 * @param {AbortSignal} signal
 * @param {(change: FlightChange) => void} done
 */
export async function flightNotes(summary, path, signal, done) {
  /** @type {Aircraft[]} */
  const known = await get('/api/vehicles', signal)
  const says = h('p', { role: 'status' })
  /** @param {FlightChange} change */
  const keep = async change => {
    says.className = ''
    try {
      Object.assign(summary, await patch(path, change))
      says.textContent = 'Kept.'
      done(change)
    } catch (error) {
      says.className = 'remark bad'
      says.textContent = sentence(error)
    }
  }
  const title = h('input',
    { type: 'text', maxlength: 200, value: summary.title, change: () => keep({ title: title.value.trim() }) })
  const comment = h('textarea', { rows: 3, maxlength: 20000, change: () => keep({ comment: comment.value }) })
  comment.value = summary.comment
  const tags = h('input', { type: 'text', value: summary.tags.join(', '),
    change: () => keep({ tags: tags.value.split(',').map(tag => tag.trim()).filter(Boolean) }) })
  const { aircraft } = summary
  const itself = aircraft.id && !aircraft.by_hand ? aircraft.name : 'the station chooses'
  const why = aircraft.by_hand || aircraft.problem ? 'What it is identified with'
    : `${aircraft.why[0].toUpperCase()}${aircraft.why.slice(1)}`
  /** @type {Choice[]} */
  const choices = [['', `${itself} (by itself)`], ...known.map(one => [one.id, one.name])]
  if (aircraft.by_hand && !known.some(one => one.id === aircraft.id))
    choices.push([aircraft.id ?? '', `${aircraft.name} (deleted)`])
  const vehicle = select(choices, aircraft.by_hand ? aircraft.id : '', value => keep({ vehicle: value }))
  return h('section', { class: 'notes', 'aria-label': 'About this flight' },
    aircraft.problem ? remark('note', h('p', {}, `Aircraft: ${aircraft.problem}. `),
      h('p', {}, h('a', { class: 'button', href: '#/aircraft/new' }, 'Describe an aircraft'))) : null,
    h('div', { class: 'grid' }, field('Aircraft', vehicle, why), field('Name of the flight', title),
      field('Tags', tags, 'With commas between: calm, pulses')),
    h('details', { open: Boolean(summary.comment) }, h('summary', {}, 'Comment'),
      field('Comment', comment, 'Weather, what was changed, who flew')), says)
}
