// What a shared link shows, and how one is made: one flight, its report and its recording, for some days.

import { get, getIfThere, post, remove, sentence, statusOf } from '../shared/api.js'
import { field, h, remark } from '../shared/dom.js'
import { duration, utc } from '../shared/format.js'
import { flightTitle } from './flightchoice.js'
import { download, opened } from '../shared/links.js'

/**
 * The view of somebody who came with a link: parts is its token.
 * @param {HTMLElement} page
 * @param {string[]} parts
 * @param {URLSearchParams} query
 * @param {AbortSignal} signal
 */
export async function shared(page, [token = ''], query, signal) {
  const known = await post('/api/login', { token }).catch(error => {
    if (![401, 422].includes(statusOf(error) ?? 0)) throw error
  })
  if (!known) {
    page.append(h('h1', {}, 'This link shows nothing any more'),
      h('p', {}, 'It has ended, or a part of it is missing. Ask whoever sent it for another.'))
    return
  }
  const { flight } = known
  const path = `/api/flights/${encodeURIComponent(flight)}`
  /** @type {FlightSummary} */
  const summary = await get(path, signal)
  const found = await getIfThere(`${path}/identification`, signal)
  page.append(h('h1', {}, `Flight ${flightTitle(summary)}`),
    h('p', {}, `${utc(summary.start)}, ${duration(summary.duration_s)}`),
    h('p', { class: 'row' }, found && opened(`${path}/report`, 'Open the report'),
      !summary.recording_deleted && download(`${path}/recording`, `${flight}.mcap`, 'Download the recording')),
    ...(found ? [] : [h('p', {}, 'No model has been identified from this flight yet.')]))
}

/**
 * What makes a link to a flight, and ends those that there are. path: of the flight in the interface.
 * @param {string} path
 * @param {string} flight
 */
export function sharing(path, flight) {
  const days = h('input', { type: 'number', min: 1, max: 366, value: 30, required: true })
  const says = h('div', { role: 'status' })
  let shown = ''
  const links = h('ul', {})
  const failed = h('div', { role: 'status' })
  const trouble = (/** @type {unknown} */ error) => failed.replaceChildren(remark('bad', sentence(error)))
  const list = async () => {
    failed.replaceChildren()
    const known = /** @type {ShareEntry[]} */ (await get('/api/shares')).filter(one => one.flight === flight)
    links.replaceChildren(...known.map(one => {
      const end = async (/** @type {any} */ event) => {
        event.target.disabled = true
        try {
          await remove(`/api/shares/${one.id}`)
          if (one.id === shown) says.replaceChildren()
          await list()
        } catch (error) {
          event.target.disabled = false
          trouble(error)
        }
      }
      const label = `End the link by ${one.maker}, until ${day(one)}`
      return h('li', {}, h('span', {}, `Link by ${one.maker}, until ${day(one)}`), ' ',
        h('button', { type: 'button', 'aria-label': label, click: end }, 'End'))
    }))
  }
  return h('details', { class: 'panel', toggle: async event => {
    if (event.target.open) await list().catch(trouble)
  } }, h('summary', {}, 'Share this flight'),
    h('form', { submit: async event => {
      event.preventDefault()
      try {
        const made = await post(`${path}/share`, { days: Number(days.value) })
        shown = made.id
        const address = h('input', { type: 'text', readonly: true, value: new URL(made.path, location.href).href })
        says.replaceChildren(field('Link', address, `Whoever has it sees this flight alone, until ${day(made)}.`),
          ...(['localhost', '127.0.0.1', '[::1]'].includes(location.hostname)
            ? [remark('note',
              'This link works on this device alone. Open this page by the address of the station in the network, and '
                + 'make it there.')] : []))
        address.select()
        await list()
      } catch (error) {
        trouble(error)
      }
    } }, field('Days', days, 'After these it shows nothing any more'), h('button', {}, 'Make a link')),
    says, failed, links)
}

/** Until when a link holds. @param {{ expires: number }} link */
const day = link => utc(new Date(1000 * link.expires).toISOString())
