// The list of flights, and taking in logs.

import { get, post, remove, upload } from './api.js'
import { announce } from './announce.js'
import { field, h, remark, table } from './dom.js'
import { findFlights, flightSearch, flightTitle } from './flightchoice.js'
import { outcomeWords } from './flightnotes.js'
import { duration, size, utc } from './format.js'

/** What the list shows of one flight, its name a link. */
function row(flight) {
  const box = h('input', { type: 'checkbox', value: flight.id, 'aria-label': `Choose ${flightTitle(flight)}` })
  return [
    [box, h('a', { href: `#/flights/${encodeURIComponent(flight.id)}`, class: flight.source === 'upload' || flight.title ? null : 'whole' },
      flightTitle(flight)), flight.tags.map(tag => [' ', h('span', { class: 'tag' }, tag)])],
    utc(flight.start), duration(flight.vehicle_duration_s ?? flight.duration_s), outcomeWords(flight), String(flight.system ?? '–'), size(flight.bytes),
  ]
}

/** The view of all flights. */
export async function flights(page, parts, query, signal) {
  const list = h('div', { 'aria-live': 'off' })
  const [after, search] = [query.get('after'), query.get('search') ?? '']
  const take = (found, words) => list.replaceChildren(...content(found, words))
  const show = async () => {
    const found = await findFlights(search, signal, after)
    take(found, search)
    return found
  }
  const [first, deleted] = await Promise.all([show(), get('/api/flights?deleted=true&limit=200', signal)])
  const many = first.next || after || search
  page.append(h('h1', {}, 'Flights'), uploadForm(show, signal), h('h2', {}, 'Recorded and uploaded'),
    ...(many ? [flightSearch(take, signal, search)] : []), list,
    ...(deleted.flights.length ? [bin(deleted.flights, show)] : []))
}

/** What was deleted in the last day, and can be taken back. */
function bin(found, show) {
  const words = h('p', { role: 'status' })
  const row = one => {
    const item = h('li', {}, `${flightTitle(one)} `, h('button', { 'aria-label': `Take back ${flightTitle(one)}`, click: async () => {
      try {
        await post(`/api/flights/${encodeURIComponent(one.id)}/restore`, {})
        item.remove()
        words.textContent = `${flightTitle(one)} is in the list again.`
        await show()
      } catch (error) {
        words.textContent = error.message
      }
    } }, 'Take back'))
    return item
  }
  return h('details', {}, h('summary', {}, `Deleted in the last day (${found.length})`),
    h('ul', {}, found.map(row)), words)
}

function content(found, words) {
  if (!found.flights.length && words) {
    return [remark('note', h('p', {}, `No flight has “${words}” in its name or date.`))]
  }
  if (!found.flights.length) {
    return [remark('note', h('p', {}, 'There is no flight yet. Start the vehicle: what it sends is recorded by itself, '
      + 'and the flight stands here. Or upload a log above.'), h('p', {}, h('a', { href: '#/live' }, 'See the links')))]
  }
  const head = ['Flight', 'Start (UTC)', 'Duration', 'Result', 'System', 'Size']
  return [
    table('Flights, newest first', head, found.flights.map(row)),
    together(),
    found.next && h('p', {}, h('a', { class: 'button', 
      href: `#/flights?${new URLSearchParams({ after: found.next, ...(words && { search: words }) })}` },
      'Older flights')),
  ].filter(Boolean)
}

/** What is done with all flights that are chosen in the list. */
function together() {
  const says = h('p', { role: 'status' })
  const each = (words, act) => async event => {
    const boxes = [...document.querySelectorAll('tbody input[type=checkbox]:checked')]
    if (!boxes.length) {
      says.textContent = 'Choose flights in the list first.'
      return
    }
    if (words.ask && !confirm(`${words.ask} ${boxes.length} flights?`)) return
    event.target.disabled = true
    const refused = []
    for (const box of boxes) {
      try {
        await act(box.value)
        box.checked = false
      } catch (error) {
        refused.push(`${box.value}: ${error.message}`)
      }
    }
    event.target.disabled = false
    const done = boxes.length - refused.length
    says.replaceChildren(`${words.done}: ${done} of ${boxes.length}.`, ...refused.map(text => remark('bad', text)))
  }
  return h('div', {}, h('p', { class: 'row' },
    h('button', { click: each({ done: 'Identifications queued' }, id => post(`/api/flights/${encodeURIComponent(id)}/jobs`, { kind: 'identify' })) }, 'Identify those chosen'),
    h('button', { click: each({ ask: 'Delete', done: 'Deleted (for a day they can be taken back)' }, id => remove(`/api/flights/${encodeURIComponent(id)}`)) }, 'Delete those chosen')), says)
}

function uploadForm(done, signal) {
  const input = h('input', { type: 'file', accept: '.mcap,.tlog,.bin,.ulg', required: true })
  const bar = h('progress', { max: 1, value: 0, 'aria-label': 'Upload' })
  const words = h('p', { role: 'status' })
  const button = h('button', { class: 'main' }, 'Upload')
  const send = async event => {
    event.preventDefault()
    const [file] = input.files
    button.disabled = true
    words.className = ''
    words.before(bar)
    const progress = share => {
      bar.value = share
      words.textContent = share < 1 ? `${file.name}: ${Math.floor(100 * share)} % of ${size(file.size)} sent`
        : `${file.name} is sent; the ground station reads it …`
    }
    progress(0)
    try {
      const flight = await upload(file, progress, signal)
      words.replaceChildren(`${file.name} is in the list: `,
        h('a', { href: `#/flights/${encodeURIComponent(flight.id)}` }, 'open it'), flight.note && ` (${flight.note})`)
      await done()
    } catch (error) {
      words.className = 'remark bad'
      words.textContent = `${file.name} was not taken: ${error.message}`
      announce(words.textContent)
    } finally {
      bar.remove()
      button.disabled = false
    }
  }
  return h('form', { class: 'panel', submit: send },
    field('Upload a log', input, 'A recording (.mcap), a .tlog, an ArduPilot .bin or a PX4 .ulg'), button, words)
}
