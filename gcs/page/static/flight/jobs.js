// Jobs of a flight: starting them, following them, their errors in words.

import { get, post, remove, sentence } from '../shared/api.js'
import { announce } from '../shared/announce.js'
import { field, h, remark, select, there } from '../shared/dom.js'
import { findFlights, flightSearch, flightTitle } from './flightchoice.js'
import { utc } from '../shared/format.js'
import { modelTitle } from '../model/modeltitle.js'

const KINDS = { identify: 'Identification', discrepancy: 'Discrepancy', design: 'Plan' }
const TABS = { identify: 'model', discrepancy: 'discrepancy', design: 'plan' }
const STATES = { queued: 'waits for its turn', running: 'runs', done: 'done', failed: 'failed', skipped: 'skipped',
  cancelled: 'cancelled' }
const EVERY_MS = 1000

/**
 * The section of jobs of a flight; resolves to what puts a further job into its list. over: called behind each job that
 * ends.
 * @param {HTMLElement} page
 * @param {FlightSummary} summary
 * @param {AbortSignal} signal
 * @param {() => void} over
 * @returns {Promise<TakeJob>}
 */
export async function jobs(page, summary, signal, over) {
  /** @type {[ModelItem[], FlightPage]} */
  const [models, others] = await Promise.all([
    get('/api/models', signal), findFlights({}, signal),
  ])
  const list = h('ul', { class: 'jobs' })
  const none = h('p', {}, 'No job was started for this flight.')
  /** @type {TakeJob} */
  const add = job => {
    none.remove()
    list.prepend(item(job, signal, add, over))
  }
  ;[...summary.jobs].sort((a, b) => a.created_ns - b.created_ns).forEach(add)
  page.append(h('h2', {}, 'Model and discrepancy'))
  if (summary.state === 'recording') {
    page.append(remark('note', h('p', {}, 'Jobs can be started when the recording is over.')))
  } else {
    /** @param {JobRequest} request @returns {Promise<Job>} */
    const start = request => post(`/api/flights/${encodeURIComponent(summary.id)}/jobs`, request).then(job => {
      add(job)
      return job
    })
    page.append(h('div', { class: 'pair' }, 
      identifyForm(judges(summary, others, signal), models, start),
      discrepancyForm(judges(summary, others, signal), models, start)))
  }
  page.append(h('h3', {}, 'Jobs'), list)
  if (!summary.jobs.length) list.before(none)
  return add
}

/** @typedef {{ element: HTMLElement, chosen: () => string[] }} Judges */

// Without a vehicle, or any stamped motion of it, there is nothing to compare a model with.
/** @param {Flight} flight */
const canJudge = flight => flight.state !== 'recording' && !flight.recording_deleted
  && flight.system !== null && flight.vehicle_duration_s !== null

/**
 * A choice of flights that the result is judged on: of the newest, and of those that are looked for.
 * @param {FlightSummary} summary
 * @param {FlightPage} newest
 * @param {AbortSignal} signal
 */
function judges(summary, newest, signal) {
  const list = h('fieldset', { class: 'choices' })
  /** @returns {HTMLInputElement[]} */
  const checked = () => [.../** @type {NodeListOf<HTMLInputElement>} */ (list.querySelectorAll('input:checked'))]
  /** @param {FlightPage} found @param {string} words */
  const show = (found, words) => {
    const kept = checked().flatMap(box => box.parentElement ?? [])
    const there = new Set(checked().map(box => box.value))
    const boxes = found.flights.filter(one => one.id !== summary.id && !there.has(one.id) && canJudge(one))
      .map(one => h('label', { class: 'choice' }, h('input', { type: 'checkbox', value: one.id }), flightTitle(one)))
    const none = words ? `No other flight has “${words}” in its name or date.`
      : 'There is no other flight; fly or upload one to judge the model on.'
    list.replaceChildren(h('legend', {}, 'Validate on'), ...kept, ...boxes,
      ...(boxes.length ? [] : [h('p', { class: 'hint' }, none)]),
      ...(found.next ? [h('p', { class: 'hint' }, 'There are older flights; look for them above.')] : []))
  }
  show(newest, '')
  const element = newest.next ? h('div', {}, flightSearch(show, signal), list) : list
  return { element, chosen: () => checked().map(box => box.value) }
}

/**
 * @param {string} title
 * @param {string} words
 * @param {string} label
 * @param {Child} parts
 * @param {() => Promise<Job>} submit
 */
function form(title, words, label, parts, submit) {
  const says = h('p', { role: 'status' })
  return h('form', {
    class: 'panel', submit: async event => {
      event.preventDefault()
      says.className = ''
      says.textContent = 'Sent …'
      try {
        const job = await submit()
        says.textContent = ['Started; its progress stands below.', ...job.log].join(' ')
      } catch (error) {
        says.className = 'remark bad'
        says.textContent = sentence(error)
      }
    },
  }, h('h3', {}, title), h('p', {}, words), parts, h('button', { class: 'main' }, label), says)
}

/** @param {ModelItem[]} models @returns {Choice[]} */
const named = models => models.map(model => [model.id, modelTitle(model, true)])

/** @param {Judges} validate @param {ModelItem[]} models @param {(request: JobRequest) => Promise<Job>} start */
function identifyForm(validate, models, start) {
  const method = select([['auto', 'chosen by the flight'],
    ['map', 'output error with an estimated noise spectrum'], ['ee', 'equation error'], ['oe', 'output error'],
    ['fe', 'filter error']], 'auto')
  const prior = select([['', 'none'], ...named(models)], '')
  const [from, to] = [0, 1].map(() => h('input', { type: 'number', min: 0, step: 'any' }))
  const right = h('input', { type: 'text', autocomplete: 'off', spellcheck: false })
  return form('Identify the model', 'Estimates sensor errors and coefficients from this flight.', 'Identify', [
    validate.element,
    h('details', {}, h('summary', {}, 'More settings'), field('Method', method),
      field('Prior model', prior), field('From, s', from, 'Empty: the airborne, excited parts are found'),
      field('To, s', to),
      field('Signals that are right as recorded', right,
        'As q, az: whatever seems wrong with them, they are not changed')),
  ], async () => {
    if (to.value && Number(to.value) <= Number(from.value)) throw new Error('“To” must be later than “From”')
    return start({
      kind: 'identify', method: method.value, validate: validate.chosen(),
      ...(prior.value ? { prior: prior.value } : {}),
      ...(from.value ? { from: Number(from.value) } : {}), ...(to.value ? { to: Number(to.value) } : {}),
      as_recorded: right.value.split(/[\s,]+/).filter(Boolean),
    })
  })
}

/** @param {Judges} validate @param {ModelItem[]} models @param {(request: JobRequest) => Promise<Job>} start */
function discrepancyForm(validate, models, start) {
  const choice = select([...named(models), ['', 'a model file of mine …']], models[0]?.id ?? '', value => {
    file.hidden = value !== ''
  })
  const own = h('input', { type: 'file', accept: '.json' })
  const file = field('Model file (JSON)', own)
  file.hidden = models.length > 0
  const ruledOut = h('input', { type: 'text', placeholder: 'mass_error, cg_shift' })
  return form('Question a model', 'Flies the model against this flight, and names what is missing. Takes minutes.',
    'Question', [
      field('Model', choice), file, validate.element,
      h('details', {}, h('summary', {}, 'More settings'), field('Ruled out on the ground', ruledOut,
        'Effects that weighing or a test on the bench has shown not to be there, with commas between')),
    ], async () => {
      const [given] = own.files ?? []
      if (!choice.value && !given)
        throw new Error('choose a model file first, or identify one from a flight')
      const model = choice.value || await readModel(given)
      const cleared = ruledOut.value.split(',').map(name => name.trim()).filter(Boolean)
      return start({ kind: 'discrepancy', model, validate: validate.chosen(), rule_out: cleared })
    })
}

/** @param {File} file */
async function readModel(file) {
  try {
    return JSON.parse(await file.text())
  } catch {
    throw new Error(`${file.name} is no JSON; choose a file of gcs identify --write-model`)
  }
}

/**
 * One job in the list; it follows the job until that is over. add: puts a further job into the list. over: called then.
 * @param {Job} job
 * @param {AbortSignal} signal
 * @param {TakeJob} add
 * @param {() => void} over
 */
function item(job, signal, add, over) {
  const element = h('li', {})
  const problem = remark('bad')
  // A button that acts on the job: what it does, and what is to be done with the answer.
  /** @param {string} text @param {() => Promise<void>} act */
  const action = (text, act) =>
    h('button', { 'aria-label': `${text}: ${KINDS[job.kind].toLowerCase()} of ${started(job)}`,
      click: async event => {
        event.target.disabled = true
        try {
          await act()
        } catch (error) {
          problem.replaceChildren(sentence(error))
          element.append(problem)
          event.target.disabled = false
        }
      } }, text)
  const path = `/api/jobs/${job.id}`
  const actions = () => h('p', { class: 'row' }, running(job)
    ? action('Cancel',
      async () => { job = await post(`${path}/cancel`, {}); show(); announce(`${KINDS[job.kind]} cancelled`) })
    // Once more with what the flight's aircraft is now, not with the version that the first job used.
    : [action('Run again', async () => { add(await post(`${path}/rerun`, { vehicle: null })); show() }),
      action('Delete', async () => { await remove(path); element.remove(); announce(`${KINDS[job.kind]} deleted`) })])
  const show = () => element.replaceChildren(...contents(job), actions())
  show()
  const follow = async () => {
    try {
      if (!running(job)) return
      const newest = await get(path, signal)
      if (!running(job)) return  // cancelled meanwhile
      job = newest
    } catch (error) {
      if (signal.aborted) return
      element.append(remark('bad', sentence(error)))
      setTimeout(follow, 5 * EVERY_MS)
      return
    }
    show()
    if (running(job)) setTimeout(follow, EVERY_MS)
    else {
      announce(`${KINDS[job.kind]} ${STATES[job.state]}`)
      over()
    }
  }
  if (running(job)) setTimeout(follow, EVERY_MS)
  return element
}

/** @param {Job} job */
const started = job => utc(new Date(job.created_ns / 1e6).toISOString())
/** @param {Job} job */
const by = job => job.owner === 'station' ? ', by the station itself' : job.owner && `, asked for from ${job.owner}`
/** @param {Job} job */
const running = job => job.state === 'queued' || job.state === 'running'

/** @param {Job} job */
function contents(job) {
  const title = `${KINDS[job.kind]}, ${STATES[job.state]}`
  return there(
    h('p', {}, h('strong', {}, title), ` (${started(job)}${by(job)})`),
    running(job)
      && h('progress', { max: 1, value: job.progress, 'aria-label': `${title}: ${Math.round(100 * job.progress)} %` }),
    running(job) && h('p', {}, `${Math.round(100 * job.progress)} %: ${job.log.at(-1) ?? 'waiting'}`),
    job.error && remark('bad', h('p', {}, job.error)),
    job.state === 'skipped' && h('p', {}, job.log.at(-1) ?? ''),
    job.state === 'done' && h('p', {}, h('a', { class: 'button',
      href: `#/flights/${encodeURIComponent(job.flight_id)}/${TABS[job.kind]}` }, 'See the result')),
  )
}

/**
 * What stands where a flight has no result of a kind yet. words: what failed, what is missing, what to press.
 * @param {FlightSummary} summary
 * @param {JobKind} kind
 * @param {{ failed: string, missing: string, start: string }} words
 */
export function nothingYet(summary, kind, { failed, missing, start }) {
  const job = summary.jobs.find(one => one.kind === kind && one.error)
  return remark('note', h('p', {}, job ? `${failed}: ${job.error}` : missing),
    h('p', {}, h('a', { class: 'button', href: `#/flights/${encodeURIComponent(summary.id)}` }, start)))
}
