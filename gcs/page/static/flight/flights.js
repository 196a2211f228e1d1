// The list of flights, and taking in logs.

import { asking, get, post, remove, sentence, upload } from '../shared/api.js'
import { announce } from '../shared/announce.js'
import { field, h, remark, select, table, there } from '../shared/dom.js'
import { findFlights, flightTitle } from './flightchoice.js'
import { outcomeWords } from './flightnotes.js'
import { duration, size, utc } from '../shared/format.js'
import { keepQuery } from '../shared/router.js'
import { sparkline } from './sparkline.js'
import { say } from '../shared/language.js'

const PAUSE_MS = 250

/** What the list shows of one flight, its name a link. @param {Flight} flight */
function row(flight) {
  const box = h('input', { type: 'checkbox', value: flight.id, 'aria-label': `Choose ${flightTitle(flight)}` })
  return [
    [box, h('a', { href: `#/flights/${encodeURIComponent(flight.id)}`,
      class: flight.source === 'upload' || flight.title ? null : 'whole', translate: 'no' },
      flightTitle(flight)), flight.tags.map(tag => [' ', h('span', { class: 'tag', translate: 'no' }, tag)])],
    utc(flight.start), duration(flight.vehicle_duration_s ?? flight.duration_s), sparkline(flight.outline),
    outcomeWords(flight), String(flight.system ?? '–'), size(flight.bytes),
  ]
}

/**
 * The view of all flights.
 * @param {HTMLElement} page
 * @param {string[]} parts
 * @param {URLSearchParams} query
 * @param {AbortSignal} signal
 */
export async function flights(page, parts, query, signal) {
  const list = h('div', { 'aria-live': 'off' })
  /** @type {Record<string, string>} */
  const wanted = Object.fromEntries(['search', 'since', 'until', 'vehicle', 'after'].map(name =>
    [name, query.get(name) ?? '']))
  let asked = 0
  const show = async () => {
    const number = ++asked
    const found = await findFlights(wanted, signal)
    if (number === asked) list.replaceChildren(...content(found, wanted))
    return found
  }
  const [first, deleted, aircraft] = await Promise.all([
    show(), get('/api/flights?deleted=true&limit=200', signal), get('/api/vehicles', signal),
  ])
  const filtered = Object.values(wanted).some(Boolean)
  const taking = uploadForm(show, signal)
  const any = first.flights.length || filtered
  // Who has flights looks for one of them; who has none brings one.
  page.append(h('h1', {}, 'Flights'), any ? '' : taking,
    ...(first.flights.length > 1 || filtered ? [filters(wanted, aircraft, show, signal)] : []), list, any ? taking : '',
    ...(deleted.flights.length ? [bin(deleted.flights, show)] : []))
}

/**
 * Words, days and an aircraft by which the list is narrowed while one types; the address keeps them.
 * @param {Record<string, string>} wanted
 * @param {Aircraft[]} aircraft
 * @param {() => Promise<FlightPage>} show
 * @param {AbortSignal} signal
 */
function filters(wanted, aircraft, show, signal) {
  let timer = 0
  /** @param {string} name @param {string} value */
  const changed = (name, value, pause = 0) => {
    Object.assign(wanted, { [name]: value, after: '' })
    clearTimeout(timer)
    timer = setTimeout(() => {
      if (signal.aborted) return  // another view has the address now
      keepQuery(asking(wanted))
      show().catch(error => signal.aborted || announce(error.message, true))
    }, pause)
  }
  const words = h('input', { type: 'search', autocomplete: 'off', maxlength: 200, value: wanted.search,
    input: () => changed('search', words.value, PAUSE_MS) })
  /** @param {string} name */
  const day = name => {
    const input = h('input', { type: 'date', value: wanted[name], change: () => changed(name, input.value) })
    return input
  }
  /** @type {Choice[]} */
  const choices = [['', 'any'], ...aircraft.map(one => [one.id, one.name])]
  if (wanted.vehicle && !aircraft.some(one => one.id === wanted.vehicle)) choices.push([wanted.vehicle, wanted.vehicle])
  return h('div', { class: 'grid', role: 'search', 'aria-label': 'Flights' },
    field('Find a flight', words, 'A part of its name, comment, tags, aircraft or date'),
    h('details', { open: Boolean(wanted.vehicle || wanted.since || wanted.until) },
      h('summary', {}, 'By aircraft and day'),
      aircraft.length ? field('Aircraft', select(choices, wanted.vehicle, value => changed('vehicle', value))) : '',
      field('From day (UTC)', day('since')), field('To day (UTC)', day('until'))))
}

/**
 * What was deleted in the last day, and can be taken back.
 * @param {Flight[]} found
 * @param {() => Promise<FlightPage>} show
 */
function bin(found, show) {
  const words = h('p', { role: 'status' })
  /** @param {Flight} one */
  const row = one => {
    const item = h('li', {}, `${flightTitle(one)} `,
      h('button', { 'aria-label': `Take back ${flightTitle(one)}`, click: async () => {
        try {
          await post(`/api/flights/${encodeURIComponent(one.id)}/restore`, {})
          item.remove()
          words.textContent = `${flightTitle(one)} is in the list again.`
          await show()
        } catch (error) {
          words.textContent = sentence(error)
        }
      } }, 'Take back'))
    return item
  }
  return h('details', {}, h('summary', {}, `Deleted in the last day (${found.length})`),
    h('ul', {}, found.map(row)), words)
}

/** @param {FlightPage} found @param {Record<string, string>} wanted */
function content(found, wanted) {
  if (!found.flights.length && Object.values(wanted).some(Boolean)) {
    return [remark('note', h('p', {}, 'No flight fits what is asked for above.'))]
  }
  if (!found.flights.length) {
    return [remark('note', h('p', {}, 'There is no flight yet. Start the vehicle: what it sends is recorded by itself, '
      + 'and the flight stands here. Or upload a log on this page.'),
      h('p', {}, h('a', { href: '#/live' }, 'See the links')))]
  }
  const head = ['Flight', 'Start (UTC)', 'Duration', 'Height', 'Result', 'System', 'Size']
  return there(
    table('Flights, newest first', head, found.flights.map(row), true),
    together(),
    found.next && h('p', {}, h('a', { class: 'button', 
      href: `#/flights?${asking({ ...wanted, after: found.next })}` },
      'Older flights')),
  )
}

/** What is done with all flights that are chosen in the list. */
function together() {
  const says = h('p', { role: 'status' })
  /** @param {{ ask?: string, done: string }} words @param {(id: string) => Promise<unknown>} act */
  const each = (words, act) => async (/** @type {Event & { target: HTMLButtonElement }} */ event) => {
    /** @type {NodeListOf<HTMLInputElement>} */
    const checked = document.querySelectorAll('tbody input[type=checkbox]:checked')
    const boxes = [...checked]
    if (!boxes.length) {
      says.textContent = 'Choose flights in the list first.'
      return
    }
    if (words.ask && !confirm(say(`${words.ask} ${boxes.length} flights?`))) return
    event.target.disabled = true
    /** @type {string[]} */
    const refused = []
    for (const box of boxes) {
      try {
        await act(box.value)
        box.checked = false
      } catch (error) {
        refused.push(`${box.value}: ${sentence(error)}`)
      }
    }
    event.target.disabled = false
    const done = boxes.length - refused.length
    says.replaceChildren(`${words.done}: ${done} of ${boxes.length}.`, ...refused.map(text => remark('bad', text)))
  }
  return h('div', {}, h('p', { class: 'row' },
    h('button', { click: each({ done: 'Identifications queued' },
      id => post(`/api/flights/${encodeURIComponent(id)}/jobs`, { kind: 'identify' })) }, 'Identify those chosen'),
    h('button', { click: each({ ask: 'Delete', done: 'Deleted (for a day they can be taken back)' },
      id => remove(`/api/flights/${encodeURIComponent(id)}`)) }, 'Delete those chosen')), says)
}

// Files whose columns may need words, and what these look like.
const TABLES = /\.(csv|tsv|txt|parquet|mat|db3|bag|mcap)$/i
const MAPPING = '[columns]\nalpha = "AoA probe"\naz = { "Nz" = -1.0 }\n\n[units]\nalpha = "deg"\naz = "g"'

/** @param {() => Promise<FlightPage>} done @param {AbortSignal} signal */
function uploadForm(done, signal) {
  const input = h('input',
    { type: 'file', accept: '.mcap,.tlog,.bin,.log,.ulg,.csv,.tsv,.txt,.parquet,.mat,.npz,.db3,.bag', required: true })
  const bar = h('progress', { max: 1, value: 0, 'aria-label': 'Upload' })
  const words = h('p', { role: 'status' })
  const button = h('button', { class: 'main' }, 'Upload')
  const columns = h('textarea', { rows: 8, cols: 60, spellcheck: 'false', placeholder: MAPPING })
  const mapping = h('details', { hidden: true }, h('summary', {}, 'What its columns are'),
    field('Columns and units (TOML)', columns,
      'Only where the headers do not say it: signal = header, and the units of signals or headers. Names and units: '
        + 'docs/howto/tables.md'))
  input.addEventListener('change', () => { mapping.hidden = !TABLES.test(input.files?.[0]?.name ?? '') })
  /** @param {SubmitEvent} event */
  const send = async event => {
    event.preventDefault()
    const [file] = /** @type {FileList} */ (input.files)
    button.disabled = true
    words.className = ''
    words.before(bar)
    /** @param {number} share */
    const progress = share => {
      bar.value = share
      words.textContent = share < 1 ? `${file.name}: ${Math.floor(100 * share)} % of ${size(file.size)} sent`
        : `${file.name} is sent; the ground station reads it …`
    }
    progress(0)
    try {
      const flight = await upload(file, mapping.hidden ? '' : columns.value, progress, signal)
      words.replaceChildren(`${file.name} is in the list: `,
        h('a', { href: `#/flights/${encodeURIComponent(flight.id)}` }, 'open it'), flight.note && ` (${flight.note})`)
      await done()
    } catch (error) {
      words.className = 'remark bad'
      words.textContent = `${file.name} was not taken: ${sentence(error)}`
      mapping.open ||= !mapping.hidden
      announce(words.textContent)
    } finally {
      bar.remove()
      button.disabled = false
    }
  }
  return h('form', { class: 'panel', submit: send },
    field('Upload a log', input,
      'A recording (.mcap), a .tlog, an ArduPilot .bin, a PX4 .ulg, a table (.csv, .parquet, .mat, .npz) or a ROS bag'),
      mapping, button, words)
}
