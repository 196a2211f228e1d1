// Links to what the service sends as a file or a page. A link cannot carry the token, so with one the file is fetched.

import { hand, request, token } from './api.js'
import { announce } from './announce.js'
import { h } from './dom.js'

/** A link that downloads `path` as `name`. */
export const download = (path, name, text) => h('a', {
  class: 'button', href: path, download: name,
  click: event => token() && (event.preventDefault(), fetchFile(path, name, null)),
}, text)

/** A link that opens the page at `path` in another tab. */
export const opened = (path, text) => h('a', {
  class: 'button', href: path, target: '_blank', rel: 'noopener',
  click: event => token() && (event.preventDefault(), fetchFile(path, '', window.open('', '_blank'))),
}, text)

async function fetchFile(path, name, window_) {
  try {
    hand(await (await request(path)).blob(), name, window_)
  } catch (error) {
    window_?.close()
    announce(error.message, true)
  }
}
