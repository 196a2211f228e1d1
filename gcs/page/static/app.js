// Start: the views by name, and the line of health at the bottom.

import { get, sentence } from './shared/api.js'
import { aircraft } from './aircraft/aircraft.js'
import { compare } from './model/compare.js'
import { byId } from './shared/dom.js'
import { size } from './shared/format.js'
import { flight } from './flight/flight.js'
import { flights } from './flight/flights.js'
import { listen } from './shared/keys.js'
import { languageChooser, translate } from './shared/language.js'
import { live } from './live/live.js'
import { start } from './shared/router.js'
import { shared } from './flight/sharing.js'
import { chooser, dress } from './shared/theme.js'

const HEALTH_EVERY_MS = 5000

async function health() {
  const line = byId('health')
  try {
    /** @type {Health} */
    const state = await get('/api/health')
    const links = `${state.links_connected} of ${state.links_total} links connected`
    line.textContent = state.problem ? `Trouble: ${state.problem}`
      : `${links}; ${size(state.disk_free_bytes)} free; version ${state.version}`
    line.classList.toggle('bad', Boolean(state.problem))
  } catch (error) {
    line.textContent = `Trouble: ${sentence(error)}`
    line.classList.add('bad')
  }
}

// Where browsers allow it, the page opens without the station, and says that it is away.
if ('serviceWorker' in navigator && isSecureContext) navigator.serviceWorker.register('/shell.js').catch(() => {})
dress()
chooser(/** @type {HTMLSelectElement} */ (byId('theme')))
listen(byId('keys'))
languageChooser(/** @type {HTMLSelectElement} */ (byId('language')))
await translate()
start({
  live,
  flights: (page, parts, query, signal) => (parts.length ? flight : flights)(page, parts, query, signal),
  aircraft,
  compare,
  shared,
}, 'live')
health()
setInterval(health, HEALTH_EVERY_MS)
