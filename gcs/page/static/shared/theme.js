// The colours: as the device has them, or as somebody chose.

import { keep, kept } from './kept.js'

const CHOSEN = 'theme'
const THEMES = ['light', 'dark', 'sunlight']
const dark = matchMedia('(prefers-color-scheme: dark)')

/** Show the theme that was chosen, else the device's. */
export function dress() {
  const chosen = kept(CHOSEN) ?? ''
  const theme = THEMES.includes(chosen) ? chosen : dark.matches ? 'dark' : 'light'
  document.documentElement.dataset.theme = theme
}

/** The choice at the bottom of the page. @param {HTMLSelectElement} select */
export function chooser(select) {
  const chosen = kept(CHOSEN) ?? ''
  select.value = THEMES.includes(chosen) ? chosen : ''
  select.addEventListener('change', () => {
    keep(CHOSEN, select.value || null)
    dress()
  })
  dark.addEventListener('change', dress)
}
