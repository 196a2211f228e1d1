// A flight's page: its summary, its signals and jobs, its model, its discrepancy.

import { get, getIfThere, remove, sentence } from '../shared/api.js'
import { announce } from '../shared/announce.js'
import { h, listing, remark, there } from '../shared/dom.js'
import { discrepancy } from '../model/discrepancy.js'
import { duration, size, utc } from '../shared/format.js'
import { identification } from '../model/identification.js'
import { flightNotes, outcomeLine } from './flightnotes.js'
import { jobs } from './jobs.js'
import { flightTitle } from './flightchoice.js'
import { download } from '../shared/links.js'
import { plan } from '../model/plan.js'
import { sharing } from './sharing.js'
import { signals } from './signals.js'
import { use } from '../model/use.js'
import { say } from '../shared/language.js'

const TABS = [['', 'Flight'], ['model', 'Model'], ['discrepancy', 'Discrepancy'], ['use', 'Use'],
  ['plan', 'Next flight']]

/**
 * The view of one flight: parts are its id and the tab.
 * @param {HTMLElement} page
 * @param {string[]} parts
 * @param {URLSearchParams} query
 * @param {AbortSignal} signal
 */
export async function flight(page, [id, tab = ''], query, signal) {
  const path = `/api/flights/${encodeURIComponent(id)}`
  /** @type {FlightSummary} */
  const summary = await get(path, signal)
  const name = flightTitle(summary)
  const place = `#/flights/${encodeURIComponent(id)}`
  const [, title] = TABS.find(([key]) => key === tab) ?? TABS[0]
  page.append(
    h('p', { class: 'trail' }, h('a', { href: '#/flights' }, 'Flights'), ' › ', name),
    h('h1', {}, tab === 'plan' ? `Next flight after ${name}` : tab ? `${title} of flight ${name}` : `Flight ${name}`),
    h('nav', { 'aria-label': 'Parts of the flight', class: 'tabs' }, TABS.map(([key, text]) =>
      h('a', { href: key ? `${place}/${key}` : place, 'aria-current': key === tab ? 'page' : null }, text))),
  )
  if (tab === 'model') {
    identification(page, await getIfThere(`${path}/identification`, signal), summary, signal)
  } else if (tab === 'discrepancy') {
    discrepancy(page, await getIfThere(`${path}/discrepancy`, signal), summary, signal)
  } else if (tab === 'use') {
    use(page, await getIfThere(`${path}/identification`, signal), summary, signal)
  } else if (tab === 'plan') {
    await plan(page, await getIfThere(`${path}/design`, signal), summary, signal)
  } else {
    const again = (/** @type {FlightChange} */ change) => {
      if ('vehicle' in change) location.reload()  // its signals are others with another aircraft
      const heading = page.querySelector('h1')
      if ('title' in change && heading) heading.textContent = `Flight ${flightTitle(summary)}`
    }
    const outcome = h('div', {}, outcomeLine(summary))
    const over = async () => {
      try {
        outcome.replaceChildren(outcomeLine(await get(path, signal)) ?? '')
      } catch (error) {
        if (!signal.aborted) announce(sentence(error))
      }
    }
    page.append(outcome, ...facts(summary, path), await flightNotes(summary, path, signal, again))
    const work = h('div', {})
    const list = jobs(work, summary, signal, over)
    list.catch(() => null)  // said where it is waited for
    await signals(page, summary, query, signal, async (/** @type {Job} */ job) => (await list)(job))
    page.append(work)
    await list
    if (summary.state !== 'recording') page.append(sharing(path, summary.id), deletion(path, name))
  }
}

/**
 * Deleting the flight, which asks first, and then leads to the list, where it can be taken back.
 * @param {string} path
 * @param {string} name
 */
function deletion(path, name) {
  const words = remark('bad')
  const button = h('button', { click: async event => {
    if (!confirm(say(`Delete flight ${name} with its recording, models and results? For a day it can be taken back.`)))
      return
    event.target.disabled = true
    try {
      await remove(path)
      location.hash = '#/flights'
      announce(`${name} is deleted. For a day it can be taken back, at the end of this list.`, true)
    } catch (error) {
      words.replaceChildren(sentence(error))
      button.after(words)
      event.target.disabled = false
    }
  } }, 'Delete this flight')
  return h('p', { class: 'row' }, button)
}

// A recording played, or simulated, faster than it was flown: both times are shown.
/** @param {FlightSummary} summary */
function flown(summary) {
  const received = summary.duration_s
  const own = summary.vehicle_duration_s ?? received
  return Math.abs(own - received) <= Math.max(0.05 * received, 1) ? duration(own)
    : `${duration(own)} by the vehicle’s clock, received in ${duration(received)}`
}

/** @param {FlightSummary} summary @param {string} path */
function facts(summary, path) {
  const messages = Object.values(summary.topics).reduce((sum, count) => sum + count, 0)
  const entries = {
    'Start (UTC)': utc(summary.start),
    Duration: flown(summary),
    Messages: `${(messages || summary.messages).toLocaleString('en')} (${summary.lost} lost)`,
    'Vehicle’s system id': String(summary.system ?? 'none'),
    'Came by': summary.source === 'upload' ? 'upload' : 'link',
    Ended: summary.end_reason || '–',
  }
  const parts = Array.from({ length: summary.parts }, (_, index) => download(
    `${path}/recording?part=${index + 1}`, `${summary.id}${summary.parts > 1 ? `-${index + 1}` : ''}.mcap`,
    summary.parts > 1 ? `Recording, part ${index + 1} of ${summary.parts}`
      : `Recording (MCAP, ${size(summary.bytes)})`))
  return there(
    h('dl', { class: 'facts' }, Object.entries(entries).map(([term, text]) =>
      h('div', {}, h('dt', {}, term), h('dd', {}, text)))),
    summary.damage.length ? remark('bad', h('h2', {}, 'Damage'), listing(summary.damage)) : null,
    summary.warnings.length ? remark('note', h('h2', {}, 'Warnings'), listing(summary.warnings)) : null,
    summary.ground.length
      ? h('p', {}, 'Recorded on the ground behind it: ', summary.ground.map((one, index) => [index ? ', ' : '',
        h('a', { href: `#/flights/${encodeURIComponent(one.id)}` },
          `${duration(one.duration_s)} from ${utc(one.start)}`)])) : null,
    summary.follows ? h('p', {}, 'Recorded on the ground behind ',
      h('a', { href: `#/flights/${encodeURIComponent(summary.follows)}` }, summary.follows), '.') : null,
    summary.recording_deleted ? remark('note',
      h('p', {}, `The recording was deleted on ${utc(summary.recording_deleted)} to make room; its results are kept.`))
      : h('p', { class: 'row' }, parts),
  )
}
