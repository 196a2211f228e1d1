// What single keys do, and the list of them; none is taken from somebody who types.

import { h } from './dom.js'
import { keep, kept } from './kept.js'

const OFF = 'keys-off'

/** @type {[string, string, () => void][]} */
const KEYS = [
  ['1', 'Live', () => go('#/live')],
  ['2', 'Flights', () => go('#/flights')],
  ['3', 'Aircraft', () => go('#/aircraft')],
  ['4', 'Compare', () => go('#/compare')],
  ['m', 'Mark this moment (live)', () => press('mark')],
  ['n', 'Write a note (live)', () => press('note')],
  ['c', 'Count down what to fly next (live)', () => press('count')],
  ['r', 'Read aloud what to fly next, or not (live)', () => press('speak')],
  ['?', 'This list', () => list()],
]

/** @param {string} address */
const go = address => { location.hash = address }

/** Press, or put the cursor into, what a view offers under a name. @param {string} name */
function press(name) {
  const found = /** @type {HTMLElement | null} */ (document.querySelector(`[data-key=${name}]`))
  if (!found || found.closest('[hidden]')) return
  if (found.matches('input')) found.focus()
  else found.click()
}

/** @type {HTMLDialogElement | null} */
let shown = null

function list() {
  if (shown) {
    shown.close()
    return
  }
  shown = h('dialog', { 'aria-labelledby': 'keys-heading', close: () => { shown?.remove(); shown = null } },
    h('h2', { id: 'keys-heading' }, 'Keys'),
    h('dl', { class: 'keys' }, KEYS.map(([key, what]) => [h('dt', {}, h('kbd', {}, key)), h('dd', {}, what)])),
    h('p', {}, h('label', {}, h('input', { type: 'checkbox', checked: kept(OFF) !== 'yes',
      change: event => keep(OFF, event.target.checked ? null : 'yes') }), ' Keys are on')),
    h('button', { type: 'button', click: () => shown?.close() }, 'Close'))
  document.body.append(shown)
  shown.showModal()
}

/** @param {EventTarget | null} target */
const typing = target => target instanceof HTMLElement
  && (target.matches('input:not([type=checkbox]), textarea, select') || target.isContentEditable)

/** Listen for keys from here on, and give the button at the bottom of the page its list. @param {HTMLElement} button */
export function listen(button) {
  button.addEventListener('click', list)
  document.addEventListener('keydown', event => {
    if (event.repeat || kept(OFF) === 'yes' || event.ctrlKey || event.metaKey || event.altKey || typing(event.target))
      return
    const found = KEYS.find(([key]) => key === event.key)
    if (!found || (shown && found[0] !== '?')) return
    event.preventDefault()
    found[2]()
  })
}
