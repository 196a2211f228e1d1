// What this browser keeps of somebody's choices; where it may keep nothing they hold for the page alone.

/** @type {Map<string, string | null>} */
const here = new Map()

/** What was kept under a name, null for nothing. @param {string} name @returns {string | null} */
export function kept(name) {
  try {
    return localStorage.getItem(name)
  } catch {
    return here.get(name) ?? null
  }
}

/** Keep a text under a name; null forgets it. @param {string} name @param {string | null} text */
export function keep(name, text) {
  here.set(name, text)
  try {
    if (text === null) localStorage.removeItem(name)
    else localStorage.setItem(name, text)
  } catch {
    // It is kept here.
  }
}
