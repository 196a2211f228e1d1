// Named choices of signals and of how they are drawn, kept in this browser; the address alone shows one to somebody
// else.

import { announce } from '../shared/announce.js'
import { h, select } from '../shared/dom.js'

const KEY = 'layouts'
const KEPT = ['signals', 'as']

/** The layouts by name; none where the browser keeps nothing, or something else. @returns {Record<string, string>} */
function known() {
  try {
    const found = JSON.parse(localStorage.getItem(KEY) ?? '{}')
    return found && typeof found === 'object' && !Array.isArray(found) ? found : {}
  } catch {
    return {}
  }
}

/**
 * A choice of layouts, and buttons that keep the present one and forget one. query: the parameters of the address.
 * @param {URLSearchParams} query
 */
export function layouts(query) {
  const place = h('span', { class: 'row' })
  const present = () =>
    String(new URLSearchParams(KEPT.filter(key => query.get(key)).map(key => [key, query.get(key) ?? ''])))
  /** @param {Record<string, string>} all @param {string} words */
  const write = (all, words, chosen = '') => {
    try {
      localStorage.setItem(KEY, JSON.stringify(all))
      announce(words, true)
    } catch {
      announce('This browser keeps no layouts; keep the address of this page instead.', true)
    }
    show(chosen)
  }
  /** @param {string} name */
  const take = name => {
    const wanted = new URLSearchParams(known()[name])
    for (const key of KEPT) wanted.has(key) ? query.set(key, wanted.get(key) ?? '') : query.delete(key)
    location.hash = `${location.hash.split('?')[0]}?${query}`
  }
  /** @param {string} name */
  const keep = name => {
    if (!name) return
    write({ ...known(), [name]: present() }, `The layout “${name}” is kept in this browser.`, name)
  }
  /**
   * A field for the name, in place of the button that asked for it.
   * @param {MouseEvent & { target: HTMLElement }} event
   */
  const ask = event => {
    const input = h('input', { type: 'text', maxlength: 60, placeholder: 'its name', 'aria-label': 'Name of the layout',
      keydown: one => one.key === 'Enter' && keep(input.value.trim()) })
    event.target.replaceWith(input,
      h('button', { type: 'button', class: 'small', click: () => keep(input.value.trim()) }, 'Keep it'))
    input.focus()
  }
  const forget = () => {
    const name = choice.value
    const { [name]: gone, ...rest } = known()
    if (gone === undefined) announce('Choose the layout to forget first.', true)
    else write(rest, `The layout “${name}” is forgotten.`)
  }
  /** @type {HTMLSelectElement} */
  let choice
  /** @param {string} chosen */
  const show = chosen => {
    const names = Object.keys(known()).sort()
    choice = select([['', 'a layout …'], ...names.map(name => [name, name])], chosen, value => value && take(value))
    // What is drawn may have been changed by hand since: the same one can be taken again.
    choice.addEventListener('click', () => known()[choice.value] !== present() && (choice.value = ''))
    choice.setAttribute('aria-label', 'Layout')
    place.replaceChildren(...(names.length ? [choice] : []),
      h('button', { type: 'button', class: 'small', click: ask }, 'Keep as a layout'),
      ...(names.length ? [h('button', { type: 'button', class: 'small', click: forget }, 'Forget it')] : []))
  }
  show(Object.entries(known()).find(([, wanted]) => wanted === present())?.[0] ?? '')
  return place
}
