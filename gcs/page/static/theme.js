// The colours: as the device has them, or as somebody chose.

const CHOSEN = 'theme'
const THEMES = ['light', 'dark', 'sunlight']
const dark = matchMedia('(prefers-color-scheme: dark)')

/** Show the theme that was chosen, else the device's. */
export function dress() {
  const chosen = localStorage.getItem(CHOSEN)
  const theme = THEMES.includes(chosen) ? chosen : dark.matches ? 'dark' : 'light'
  document.documentElement.dataset.theme = theme
}

/** The choice at the bottom of the page. */
export function chooser(select) {
  select.value = THEMES.includes(localStorage.getItem(CHOSEN)) ? localStorage.getItem(CHOSEN) : ''
  select.addEventListener('change', () => {
    if (select.value) localStorage.setItem(CHOSEN, select.value)
    else localStorage.removeItem(CHOSEN)
    dress()
  })
  dark.addEventListener('change', dress)
}
