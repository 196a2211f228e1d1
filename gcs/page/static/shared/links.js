// Links to what the service sends as a file or a page.

import { h } from './dom.js'

/** A link that downloads `path` as `name`. @param {string} path @param {string} name @param {string} text */
export const download = (path, name, text) => h('a', { class: 'button', href: path, download: name }, text)

/** A link that opens the page at `path` in another tab. @param {string} path @param {string} text */
export const opened = (path, text) => h('a', { class: 'button', href: path, target: '_blank', rel: 'noopener' }, text)
