// The page in another language. Texts are put in where they stand in the document, so that no view knows of it: a
// catalogue
// gives for each English text the other one, {} standing for what changes, {t} where that is a text of the page too.
// What no catalogue has stays English.

import { keep, kept } from './kept.js'

const CHOSEN = 'language'
const ATTRIBUTES = ['aria-label', 'title', 'placeholder', 'alt', 'data-heading', 'label']
// What people wrote, and what is measured, is no text of the page.
const LEFT = 'code, pre, textarea, script, style, [translate=no]'
const MOST_REMEMBERED = 5000

/** @type {Record<string, string>} */
let texts = {}
/** @type {[RegExp, string][]} */
let patterns = []
/** @type {Map<string, string>} */
const remembered = new Map()
const shown = new WeakMap()

/** The languages that there are, by code, with their own names. */
function languages() {
  const listed = document.querySelector('meta[name=languages]')?.getAttribute('content') ?? ''
  return new Map(listed.split(',').filter(Boolean).map(one => /** @type {[string, string]} */ (one.split('='))))
}

/** The language of the page: as chosen, else as the browser is set, else English. */
export function language() {
  const there = languages()
  const chosen = kept(CHOSEN) ?? navigator.language.slice(0, 2)
  return there.has(chosen) ? chosen : 'en'
}

/** A text of the page in its language. @param {string} text @returns {string} */
export function say(text) {
  const found = remembered.get(text)
  if (found !== undefined) return found
  const said = translated(text)
  if (remembered.size > MOST_REMEMBERED) remembered.clear()
  remembered.set(text, said)
  return said
}

/** @param {string} text @returns {string} */
function translated(text) {
  if (!/\p{L}/u.test(text)) return text
  if (Object.hasOwn(texts, text)) return texts[text]
  const parts = /^(\s*)(.*?)(\s*)$/su.exec(text)
  if (!parts) return text
  const [, before, core, behind] = parts
  if (Object.hasOwn(texts, core)) return before + texts[core] + behind
  for (const [pattern, words] of patterns) {
    const found = pattern.exec(core)
    if (!found) continue
    let at = 0
    return before + words.replaceAll(/\{(t?)\}/g, (_, too) => too ? say(found[++at]) : found[++at]) + behind
  }
  return text
}

/**
 * A catalogue as it is looked up: sentences with what changes in them, the longest first.
 * @param {Record<string, string>} catalogue
 */
function learn(catalogue) {
  texts = catalogue
  const changing = Object.entries(catalogue).filter(([english]) => english.includes('{}'))
  changing.sort((a, b) => b[0].length - a[0].length)
  patterns = changing.map(([english, words]) => {
    const parts = english.split('{}').map(part => part.replaceAll(/[.*+?^${}()|[\]\\]/g, '\\$&'))
    return [new RegExp(`^${parts.join('(.*?)')}$`, 'su'), words]
  })
}

/** @param {Node} node */
function put(node) {
  if (node instanceof Text) {
    if (!node.data.trim() || node.data === shown.get(node) || node.parentElement?.closest(LEFT)) return
    const said = say(node.data)
    shown.set(node, said)
    if (said !== node.data) node.data = said
    return
  }
  if (!(node instanceof Element) || node.matches(LEFT)) return
  for (const name of ATTRIBUTES) putAttribute(node, name)
  for (const child of node.childNodes) put(child)
}

/** @param {Element} element @param {string} name */
function putAttribute(element, name) {
  const text = element.getAttribute(name)
  if (!text || element.closest('[translate=no]')) return
  const said = say(text)
  if (said !== text) element.setAttribute(name, said)
}

/** Show the page in its language, now and whatever comes. */
export async function translate() {
  const code = language()
  if (code === 'en') return
  try {
    const answer = await fetch(new URL(`../language-${code}.json`, import.meta.url))
    learn(await answer.json())
  } catch {
    return  // English is better than nothing
  }
  document.documentElement.lang = code
  put(document.documentElement)
  new MutationObserver(changes => {
    for (const change of changes) {
      if (change.type === 'attributes') putAttribute(/** @type {Element} */ (change.target), change.attributeName ?? '')
      else if (change.type === 'characterData') put(change.target)
      else change.addedNodes.forEach(put)
    }
  }).observe(document.documentElement,
  { subtree: true, childList: true, characterData: true, attributes: true, attributeFilter: ATTRIBUTES })
}

/** The choice at the bottom of the page. @param {HTMLSelectElement} select */
export function languageChooser(select) {
  for (const [code, name] of languages()) select.add(new Option(name, code))
  select.value = language()
  select.addEventListener('change', () => {
    keep(CHOSEN, select.value)
    location.reload()
  })
}
