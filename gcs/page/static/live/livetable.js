// A table whose figures move while somebody reads it. Its rows stay and only texts that have changed are written, so it
// keeps
// the place it is scrolled to, the focus, and the cell that a screen reader stands on.

import { h, newId } from '../shared/dom.js'

export class LiveTable {
  /**
   * head: headings of the columns. short: those that stand before the cells where rows wrap, on a narrow screen; '' for
   * a
   * cell that needs none. named: makes the node of a row's name.
   * @param {string} caption
   * @param {string[]} head
   * @param {string[]} short
   * @param {(name: string) => Child} named
   */
  constructor(caption, head, short, named = name => h('code', {}, name)) {
    this.short = short
    this.named = named
    /** @type {string | null} */
    this.names = null
    /** @type {HTMLElement[][]} */
    this.cells = []
    const title = newId('caption')
    this.body = h('tbody', {})
    this.element = h('div',
      { class: 'wide wrapping', role: 'region', 'aria-labelledby': title, tabindex: 0, hidden: true },
      h('table', {}, h('caption', { id: title }, caption),
        h('thead', {}, h('tr', {}, head.map(text => h('th', { scope: 'col' }, text)))), this.body))
  }

  /**
   * Show rows: the name of each, and its cells, texts or pairs of a text and a class. Without rows nothing is seen.
   * @param {LiveRow[]} rows
   */
  show(rows) {
    const names = JSON.stringify(rows.map(([name]) => name))
    if (names !== this.names) {
      this.names = names
      this.cells = rows.map(row => row.slice(1).map((_, at) => h('td', { 'data-heading': this.short[at + 1] || null })))
      this.body.replaceChildren(...rows.map(([name], at) =>
        h('tr', {}, h('th', { scope: 'row' }, this.named(name)), this.cells[at])))
      this.element.hidden = !rows.length
    }
    rows.forEach((row, at) => row.slice(1).forEach((cell, column) => {
      const [text, kind] = typeof cell === 'string' ? [cell] : cell
      write(this.cells[at][column], text, kind)
    }))
  }
}

/** What each element was made to say; in another language it says something else. @type {WeakMap<Element, string>} */
const said = new WeakMap()

/**
 * Make an element say a text; nothing is touched where it does already.
 * @param {Element} element
 * @param {string} text
 */
export function write(element, text, kind = '') {
  if ((said.get(element) ?? element.textContent) !== text) element.textContent = text
  said.set(element, text)
  if (element.className !== kind) element.className = kind
}
