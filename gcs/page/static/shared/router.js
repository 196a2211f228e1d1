// Which view the address names. Every view has an address of its own, a title, and the focus when it comes.

import { post, sentence, statusOf } from './api.js'
import { byId, field, h, remark } from './dom.js'
import { say } from './language.js'

let leaving = new AbortController()

/** #/flights/ID?x=1 as its parts and its parameters. */
export function address() {
  const [path, search] = location.hash.replace(/^#\/?/, '').split('?')
  return { parts: path.split('/').filter(Boolean).map(decodeURIComponent), query: new URLSearchParams(search) }
}

/** Change the parameters of the address, without a new view. @param {URLSearchParams} query */
export function keepQuery(query) {
  const [path] = location.hash.split('?')
  history.replaceState(null, '', `${path || '#/live'}?${query}`)
}

/**
 * Show the views. views: by the first part of the address, functions (page, parts, query, signal) that fill the page.
 * @param {Record<string, View>} views
 * @param {string} fallback
 */
export function start(views, fallback) {
  const show = () => render(views, fallback)
  window.addEventListener('hashchange', show)
  document.querySelector('.skip')?.addEventListener('click', event => {
    event.preventDefault()
    byId('main').focus()
  })
  show()
}

/** @param {Record<string, View>} views @param {string} fallback */
async function render(views, fallback) {
  leaving.abort()
  leaving = new AbortController()
  const { signal } = leaving
  const { parts, query } = address()
  const name = parts[0] in views ? parts[0] : fallback
  for (const link of document.querySelectorAll('header nav a')) {
    if (link.getAttribute('href') === `#/${name}`) link.setAttribute('aria-current', 'page')
    else link.removeAttribute('aria-current')
  }
  const main = byId('main')
  const page = h('div', {})
  main.setAttribute('aria-busy', 'true')
  main.replaceChildren(page)
  try {
    await views[name](page, parts.slice(1), query, signal)
  } catch (error) {
    if (!signal.aborted) page.replaceChildren(...trouble(error, () => render(views, fallback)))
  }
  if (signal.aborted) return
  main.removeAttribute('aria-busy')
  const heading = page.querySelector('h1')
  document.title = say(`${heading?.textContent ?? 'Ground station'} – Ground station`)
  heading?.setAttribute('tabindex', '-1')
  heading?.focus({ preventScroll: true })
  window.scrollTo(0, 0)
}

/** @param {unknown} error @param {() => void} again */
function trouble(error, again) {
  const status = statusOf(error)
  if (status === 401) return [h('h1', {}, 'Token needed'), tokenForm(again)]
  console.error(error)
  const gone = status === 404 || status === 410
  return [
    h('h1', {}, gone ? 'Nothing here' : 'That did not work'),
    remark('bad', h('p', {}, sentence(error))),
    h('p', {}, gone ? h('a', { class: 'button', href: '#/flights' }, 'To the list of flights')
      : h('button', { click: again }, 'Try again')),
  ]
}

/** @param {() => void} again */
function tokenForm(again) {
  const input = h('input', { type: 'password', autocomplete: 'current-password', required: true })
  const refused = h('div', {})
  return h('form', {
    submit: async event => {
      event.preventDefault()
      try {
        await post('/api/login', { token: input.value.trim() })
        again()
      } catch (error) {
        const words = statusOf(error) === 401 ? 'The ground station did not accept this token.' : sentence(error)
        refused.replaceChildren(remark('bad', h('p', { role: 'alert' }, words)))
      }
    },
  },
  refused,
  field('Token of the ground station', input,
    'Whoever runs the station makes one with gcs token add, or set it as GCS_TOKEN. This browser keeps it for 30 '
      + 'days.'),
  h('button', { class: 'main' }, 'Open'))
}
