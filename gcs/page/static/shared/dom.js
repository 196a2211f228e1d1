// Elements out of plain data. Text goes in as text nodes only: names come from logs and are never markup.

const SVG = 'http://www.w3.org/2000/svg'

/** @template {Element} E @param {E} element @param {object | null | undefined} attributes @param {Child[]} children */
function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes ?? {})) {
    if (value === null || value === undefined || value === false) continue
    if (typeof value === 'function') element.addEventListener(name, value)
    else element.setAttribute(name, value === true ? '' : value)
  }
  const all = /** @type {unknown[]} */ (children).flat(Infinity)
  const nodes = all.filter(child => child !== null && child !== undefined && child !== false)
  element.append(.../** @type {(Node | string)[]} */ (nodes))
  return element
}

/**
 * An HTML element; functions among the attributes are listeners by the event's name.
 * @template {keyof HTMLElementTagNameMap} Tag
 * @param {Tag} tag
 * @param {Attributes<HTMLElementTagNameMap[Tag]>} [attributes]
 * @param {...Child} children
 */
export const h = (tag, attributes, ...children) => fill(document.createElement(tag), attributes, children)

/**
 * An SVG element.
 * @template {keyof SVGElementTagNameMap} Tag
 * @param {Tag} tag
 * @param {Record<string, AttributeValue>} [attributes]
 * @param {...Child} children
 */
export const svg = (tag, attributes, ...children) => fill(document.createElementNS(SVG, tag), attributes, children)

/**
 * The element of the document that has this identifier; the document itself holds all that are asked for.
 * @param {string} id
 */
export function byId(id) {
  const found = document.getElementById(id)
  if (!found) throw new Error(`the document has no #${id}`)
  return found
}

let numbered = 0
/** An identifier that no other element has. @param {string} stem */
export const newId = stem => `${stem}-${++numbered}`

/**
 * A table with a caption; cells are texts or nodes, the first of each row is its heading. Scrolls sideways if wide; on
 * a phone the cells of a row stand below one another instead where `wraps`.
 * @param {string} caption
 * @param {string[]} head
 * @param {Child[][]} rows
 */
export function table(caption, head, rows, wraps = false) {
  if (!rows.length) return null
  const title = newId('caption')
  return h('div', { class: wraps ? 'wide wrapping' : 'wide', role: 'region', 'aria-labelledby': title, tabindex: 0 },
    h('table', {},
      h('caption', { id: title }, caption),
      h('thead', {}, h('tr', {}, head.map(text => h('th', { scope: 'col' }, text)))),
      h('tbody', {}, rows.map(([first, ...others]) =>
        h('tr', {}, h('th', { scope: 'row' }, first),
          others.map((cell, at) => h('td', { 'data-heading': wraps ? head[at + 1] : null }, cell)))))))
}

/** A list, or nothing of nothing. @param {string[]} texts */
export const listing = texts => texts.length ? h('ul', {}, texts.map(text => h('li', {}, text))) : null

/** A field with its label above it. @param {string} label @param {Control} control @param {string | null} [hint] */
export function field(label, control, hint) {
  control.id ||= newId('field')
  const described = hint && newId('hint')
  if (described) control.setAttribute('aria-describedby', described)
  return h('div', { class: 'field' }, h('label', { for: control.id }, label), control,
    hint && h('p', { id: described, class: 'hint' }, hint))
}

/**
 * A select of [value, text] pairs.
 * @param {readonly Choice[]} choices
 * @param {string | null} [chosen]
 * @param {(value: string) => void} [change]
 */
export const select = (choices, chosen, change) => h('select', { change: event => change?.(event.target.value) },
  choices.map(([value, text]) => h('option', { value, selected: value === chosen }, text)))

/** A boxed remark: kind is 'good', 'bad', 'note'. @param {string} kind @param {...Child} children */
export const remark = (kind, ...children) => h('div', { class: `remark ${kind}` }, ...children)

/** Those of the nodes that are there. @param {...Child} nodes @returns {(Node | string)[]} */
export const there = (...nodes) => /** @type {(Node | string)[]} */ (nodes.filter(Boolean))
