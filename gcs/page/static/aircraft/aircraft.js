// The aircraft of the station: the list, one of them with its versions, and taking in a vehicle file.

import { get, post, put, remove, sentence } from '../shared/api.js'
import { aircraftForm } from './aircraftsaving.js'
import { announce } from '../shared/announce.js'
import { reading } from './aircraftreading.js'
import { field, h, remark, table, there } from '../shared/dom.js'
import { number, utc } from '../shared/format.js'
import { download } from '../shared/links.js'
import { surfaceCheck } from './surfacecheck.js'
import { trends } from './trends.js'
import { say } from '../shared/language.js'

/**
 * The view of all aircraft, of one, or of a new one.
 * @param {HTMLElement} page
 * @param {string[]} parts
 * @param {URLSearchParams} query
 * @param {AbortSignal} signal
 */
export async function aircraft(page, [id, action], query, signal) {
  if (id === 'new') return newOne(page, query, signal)
  if (id) return one(page, id, action, signal)
  /** @type {Aircraft[]} */
  const found = await get('/api/vehicles', signal)
  page.append(...there(
    h('h1', {}, 'Aircraft'),
    h('p', {}, 'What a flight is identified with: mass, geometry, which servo moves what. Each flight names its '
      + 'aircraft.'),
    h('p', { class: 'row' }, h('a', { class: 'button main', href: '#/aircraft/new' }, 'Describe an aircraft')),
    found.length ? table('Aircraft of this station',
      ['Aircraft', 'Version', 'Mass', 'Span', 'Changed (UTC)', 'Doubts'], found.map(item => [
        h('a', { href: `#/aircraft/${item.id}` }, item.name), item.editable ? String(item.version) : 'as its file is',
        `${number(item.mass_kg)} kg`, `${number(item.span_m)} m`, utc(item.changed),
        item.warnings.length ? String(item.warnings.length) : '',
      ])) : remark('note', h('p', {}, 'There is none yet. A scale and a ruler are enough to begin with.')),
    importForm()))
}

/** @param {HTMLElement} page @param {URLSearchParams} query @param {AbortSignal} signal */
async function newOne(page, query, signal) {
  const copied = query.get('copy')
  /** @type {Aircraft | null} */
  const found = copied ? await get(`/api/vehicles/${encodeURIComponent(copied)}`, signal) : null
  page.append(trail('new'), h('h1', {}, copied ? `Copy of ${found?.name}` : 'A new aircraft'))
  const form = found?.reading.form ? { ...found.reading.form, name: `${found.name} copy` }
    : { name: '', numbers: {}, controls: {}, places: {}, bench: {} }
  page.append(aircraftForm({ toml: found?.reading.toml ?? '', form, signal, label: 'Keep this aircraft',
    save: async draft => {
      const made = await post('/api/vehicles', draft)
      announce(`${made.name} is kept`)
      location.hash = `#/aircraft/${made.id}`
    } }))
}

/** @param {HTMLElement} page @param {string} reference @param {string} action @param {AbortSignal} signal */
async function one(page, reference, action, signal) {
  /** @type {Aircraft} */
  const found = await get(`/api/vehicles/${encodeURIComponent(reference)}`, signal)
  const [id] = reference.split('@')
  const newest = found.version === found.versions.at(-1)
  page.append(trail(found.name), h('h1', {}, action === 'edit' ? `Change ${found.name}` : found.name))
  if (action === 'edit') {
    page.append(h('p', {},
      `What you keep becomes version ${(found.versions.at(-1) ?? 0) + 1}; flights stay with the version they were `
        + `identified with.`))
    page.append(aircraftForm({ toml: found.reading.toml, form: found.reading.form, signal, label: 'Keep the change',
      save: async draft => {
        const changed = await put(`/api/vehicles/${id}`, draft)
        announce(`Version ${changed.version} is kept`)
        location.hash = `#/aircraft/${id}`
      } }))
    return
  }
  const versions = found.versions.map(version =>
    h('a', { href: `#/aircraft/${id}@${version}`, 'aria-current': version === found.version ? 'true' : null },
      String(version)))
  page.append(...there(
    h('p', {}, found.editable ? `Version ${found.version}, ${utc(found.changed)} UTC. `
      : 'The vehicle file that the service was started with. ',
      found.versions.length > 1 && ['All versions: ', versions.map((link, i) => [i ? ', ' : '', link]), '.']),
    !newest && remark('note', h('p', {}, 'This is an older version.')),
    h('p', { class: 'row' },
      found.editable && newest && h('a', { class: 'button', href: `#/aircraft/${id}/edit` }, 'Change'),
      h('a', { class: 'button', href: `#/aircraft/new?copy=${encodeURIComponent(reference)}` }, 'Copy'),
      download(`/api/vehicles/${encodeURIComponent(reference)}/toml`, `${id}.toml`, 'Vehicle file (TOML)'),
      found.editable && h('button', { click: event => discard(event.target, id, found.name) }, 'Delete')),
    newest && h('p', {}, 'Next: take in a log of it under ', h('a', { href: '#/flights' }, 'Flights'),
      ', or let it fly on a link.'),
    described(found.reading.form), reading(found.reading), surfaceCheck(found.reading.form?.controls ?? {}, signal)))
  page.append(await trends(id, signal))
}

/** @type {Record<string, string>} */
const UNITS = { kg: 'kg', m: 'm', m2: 'm²', kgm2: 'kg m²', n: 'N', mps: 'm/s' }
/** @type {Record<string, string>} */
const NAMES = { mass: 'Mass', span: 'Span', area: 'Wing area', chord: 'Mean chord',
  max_thrust: 'Largest static thrust', propeller: 'Propeller', speed: 'Cruise speed' }

/** What was entered into the form; nothing where the form cannot show the file. @param {AircraftForm | null} form */
function described(form) {
  if (!form) return null
  const numbers = Object.entries(form.numbers).map(([key, value]) => {
    const at = key.lastIndexOf('_')
    const name = key.slice(0, at)
    return [NAMES[name] ?? name.replace('_std', ' to ±'), `${value} ${UNITS[key.slice(at + 1)] ?? ''}`.trim()]
  })
  const controls = Object.entries(form.controls).map(([name, control]) => [name[0].toUpperCase() + name.slice(1),
    control.servos.map(one => `servo ${one.servo}: ${one.pwm_us.join(', ')} µs`).join('; ')])
  return h('details', {}, h('summary', {}, 'As it was described'),
    table('Measured and typed', ['What', 'Value'], [...numbers, ...controls]))
}

/** @param {HTMLButtonElement} button @param {string} id @param {string} name */
async function discard(button, id, name) {
  if (!confirm(say(`Take ${name} from the list? Flights that were identified with it keep it.`))) return
  button.disabled = true
  try {
    await remove(`/api/vehicles/${id}`)
    announce(`${name} is deleted`)
    location.hash = '#/aircraft'
  } catch (error) {
    button.after(remark('bad', sentence(error)))
    button.disabled = false
  }
}

/** @param {string} name */
const trail = name => h('p', { class: 'trail' }, h('a', { href: '#/aircraft' }, 'Aircraft'), ' › ', name)

function importForm() {
  const input = h('input', { type: 'file', accept: '.toml', required: true })
  const words = h('p', { role: 'status' })
  return h('form', { class: 'panel', submit: async event => {
    event.preventDefault()
    const [file] = /** @type {FileList} */ (input.files)
    try {
      const made = await post('/api/vehicles', { toml: await file.text() })
      location.hash = `#/aircraft/${made.id}`
    } catch (error) {
      words.className = 'remark bad'
      words.textContent = `${file.name} was not taken: ${sentence(error)}`
    }
  } }, h('h2', {}, 'Take in a vehicle file'),
  field('Vehicle file (TOML)', input, 'Bench tables must stand in it: points = [[reference, reading], …]'),
  h('button', {}, 'Take in'), words)
}
