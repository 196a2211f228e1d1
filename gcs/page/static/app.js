// Start: the views by name, and the line of health at the bottom.

import { get } from './api.js'
import { aircraft } from './aircraft.js'
import { compare } from './compare.js'
import { size } from './format.js'
import { flight } from './flight.js'
import { flights } from './flights.js'
import { listen } from './keys.js'
import { languageChooser, translate } from './language.js'
import { live } from './live.js'
import { start } from './router.js'
import { shared } from './shared.js'
import { chooser, dress } from './theme.js'

const HEALTH_EVERY_MS = 5000

async function health() {
  const line = document.getElementById('health')
  try {
    const state = await get('/api/health')
    const links = `${state.links_connected} of ${state.links_total} links connected`
    line.textContent = state.problem ? `Trouble: ${state.problem}`
      : `${links}; ${size(state.disk_free_bytes)} free; version ${state.version}`
    line.classList.toggle('bad', Boolean(state.problem))
  } catch (error) {
    line.textContent = `Trouble: ${error.message}`
    line.classList.add('bad')
  }
}

// Where browsers allow it, the page opens without the station, and says that it is away.
if ('serviceWorker' in navigator && isSecureContext) navigator.serviceWorker.register('/shell.js').catch(() => {})
dress()
chooser(document.getElementById('theme'))
listen(document.getElementById('keys'))
languageChooser(document.getElementById('language'))
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
