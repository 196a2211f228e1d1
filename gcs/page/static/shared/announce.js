// Announcements: one status line for screen readers, which also shows when it matters.

import { byId } from './dom.js'

let hiding = 0

/** Say a sentence to screen readers; shown: on the screen too, for ten seconds. @param {string} text */
export function announce(text, shown = false) {
  const line = byId('announcements')
  line.textContent = text
  line.classList.toggle('unseen', !shown)
  clearTimeout(hiding)
  hiding = setTimeout(() => line.classList.add('unseen'), 10_000)
}
