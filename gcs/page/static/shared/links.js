// Links to what the service sends as a file or a page.

import { h } from './dom.js'

/** A link that downloads `path` as `name`. */
export const download = (path, name, text) => h('a', { class: 'button', href: path, download: name }, text)

/** A link that opens the page at `path` in another tab. */
export const opened = (path, text) => h('a', { class: 'button', href: path, target: '_blank', rel: 'noopener' }, text)
