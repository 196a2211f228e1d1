// Server-sent events over fetch, since EventSource says nothing of why it ended; a lost connection is reported and made
// again.

import { request, sentence, statusOf } from './api.js'

// The service writes at least a comment each 10 s; longer silence is a connection that died without a word.
const SILENCE_MS = 15_000
const WAITS_MS = [500, 1000, 2000, 3000]

/**
 * Follow a stream until `signal` is aborted.
 * event(name, data): every event, its data as JSON. state(text): '' when connected, else what is wrong.
 * Rejects with Problem 401 or 404, which trying again does not mend.
 * @param {string} path
 * @param {AbortSignal} signal
 * @param {{ event: (name: string, data: any) => void, state: (text: string) => void }} heard
 */
export async function follow(path, signal, { event, state }) {
  let tries = 0
  while (!signal.aborted) {
    try {
      await connection(path, signal, name_data => {
        tries = 0
        event(...name_data)
      }, () => state(''))
      throw new Error('the ground station ended the connection')
    } catch (error) {
      if (signal.aborted) return
      if (statusOf(error) === 401 || statusOf(error) === 404) throw error
      state(sentence(error))
    }
    await pause(WAITS_MS[Math.min(tries++, WAITS_MS.length - 1)], signal)
  }
}

/**
 * @param {string} path
 * @param {AbortSignal} signal
 * @param {(name_data: [string, any]) => void} event
 * @param {() => void} opened
 */
async function connection(path, signal, event, opened) {
  const silent = new AbortController()
  const stop = () => silent.abort()
  signal.addEventListener('abort', stop)
  window.addEventListener('offline', stop)
  let timer = setTimeout(stop, SILENCE_MS)
  try {
    const answer = await request(path, { signal: silent.signal, headers: { Accept: 'text/event-stream' } })
    opened()
    if (!answer.body) throw new Error('the answer holds nothing')
    const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader()
    const parse = parser(event)
    for (;;) {
      const { done, value } = await reader.read()
      if (done) return
      clearTimeout(timer)
      timer = setTimeout(stop, SILENCE_MS)
      parse(value)
    }
  } catch (error) {
    if (statusOf(error)) throw error
    throw new Error(navigator.onLine ? 'no answer from the ground station' : 'this device is offline')
  } finally {
    clearTimeout(timer)
    signal.removeEventListener('abort', stop)
    window.removeEventListener('offline', stop)
  }
}

/**
 * A function that takes the text of a stream piece by piece and calls event([name, data]) for each event.
 * @param {(name_data: [string, any]) => void} event
 * @returns {(text: string) => void}
 */
export function parser(event) {
  let rest = ''
  return text => {
    const blocks = (rest + text.replaceAll('\r', '')).split('\n\n')
    rest = blocks.pop() ?? ''
    for (const block of blocks) {
      let name = 'message'
      const data = []
      for (const row of block.split('\n')) {
        if (row.startsWith('event:')) name = row.slice(6).trim()
        else if (row.startsWith('data:')) data.push(row.slice(5).trimStart())
      }
      if (data.length) event([name, JSON.parse(data.join('\n'))])
    }
  }
}

/** @param {number} ms @param {AbortSignal} signal */
const pause = (ms, signal) => new Promise((/** @type {(value?: any) => void} */ resolve) => {
  const timer = setTimeout(resolve, ms)
  signal.addEventListener('abort', () => (clearTimeout(timer), resolve()))
  window.addEventListener('online', resolve, { once: true })
})
