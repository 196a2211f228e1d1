// Choosing among all flights: the newest stand there, others are found by words of their name, id or date.

import { asking, get, sentence } from '../shared/api.js'
import { announce } from '../shared/announce.js'
import { field, h } from '../shared/dom.js'

const SHOWN = 50
const PAUSE_MS = 250

/** How a flight is called in lists. @param {Flight} flight */
export const flightTitle = flight => flight.title || (flight.source === 'upload' ? flight.name : flight.id)

/**
 * The newest flights that match: { flights, next }; next says that there are more. wanted: as GET /api/flights has it.
 * @param {Record<string, string>} wanted
 * @param {AbortSignal} [signal]
 * @returns {Promise<FlightPage>}
 */
export const findFlights = (wanted, signal) => get(`/api/flights?${asking({ limit: SHOWN, ...wanted })}`, signal)

/**
 * A field that looks for flights while one types; take: called with what findFlights gives, and the words.
 * @param {(found: FlightPage, words: string) => void} take
 * @param {AbortSignal} signal
 */
export function flightSearch(take, signal) {
  let timer = 0
  let asked = 0
  const ask = async () => {
    const number = ++asked
    try {
      const found = await findFlights({ search: input.value }, signal)
      if (number === asked) take(found, input.value)
    } catch (error) {
      if (!signal.aborted) announce(sentence(error), true)
    }
  }
  const input = h('input', { type: 'search', autocomplete: 'off', maxlength: 200,
    input: () => {
      clearTimeout(timer)
      timer = setTimeout(ask, PAUSE_MS)
    },
    // Enter would send the form in which the field stands.
    keydown: event => event.key === 'Enter' && event.preventDefault() })
  return field('Find a flight', input, 'A part of its name, comment, tags, aircraft or date, as 2026-11-23')
}
