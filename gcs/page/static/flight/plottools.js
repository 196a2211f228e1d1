// What one does with a plot: keep its picture, draw it with another, by buttons or by dragging its heading.

import { hand, sentence } from '../shared/api.js'
import { announce } from '../shared/announce.js'
import { h } from '../shared/dom.js'

const KIND = 'application/x-plot'
/** The plot that is being dragged; nothing from elsewhere counts. @type {number | null} */
let dragged = null

/**
 * Buttons behind a plot. name: of its picture's file. moves: [words, act] of what can be done with its place.
 * @param {HTMLElement & { view?: BokehObject }} element
 * @param {string} name
 * @param {Move[]} moves
 */
export const tools = (element, name, moves) => h('details', { class: 'tools' }, h('summary', {}, 'Picture and place'),
  h('p', { class: 'row' }, ['png', 'svg'].map(kind =>
    h('button', { type: 'button', class: 'small', click: () => keep(element, name, kind) },
      `Picture (${kind.toUpperCase()})`)),
    moves.map(([words, act]) => h('button', { type: 'button', class: 'small', click: act }, words))))

/** @param {HTMLElement & { view?: BokehObject }} element @param {string} name @param {string} kind */
async function keep(element, name, kind) {
  try {
    const blob = await element.view.export(kind).to_blob()
    hand(blob, `${name.replace(/[^\w.-]+/g, '_').slice(0, 120)}.${kind}`)
  } catch (error) {
    announce(`No picture could be made: ${sentence(error)}`, true)
  }
}

/**
 * Have a plot's heading dragged onto another plot. index: the plot's; join(from, to): called with both.
 * @param {HTMLElement} element
 * @param {number} index
 * @param {(from: number, to: number) => void} join
 */
export function draggable(element, index, join) {
  const heading = /** @type {HTMLElement} */ (element.querySelector('h3'))
  heading.draggable = true
  heading.title = 'Drag onto another plot to draw both in one'
  heading.addEventListener('dragstart', event => {
    dragged = index
    const transfer = /** @type {DataTransfer} */ (event.dataTransfer)
    transfer.setData(KIND, String(index))
    transfer.effectAllowed = 'move'
  })
  heading.addEventListener('dragend', () => { dragged = null })
  element.addEventListener('dragover', event => dragged !== null && event.preventDefault())
  element.addEventListener('drop', event => {
    if (dragged === null || dragged === index) return
    event.preventDefault()
    join(dragged, index)
    dragged = null
  })
}
