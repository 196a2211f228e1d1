// What this browser keeps of somebody's choices; where it may keep nothing they hold for the page alone.

const here = new Map()

/** What was kept under a name, null for nothing. */
export function kept(name) {
  try {
    return localStorage.getItem(name)
  } catch {
    return here.get(name) ?? null
  }
}

/** Keep a text under a name; null forgets it. */
export function keep(name, text) {
  here.set(name, text)
  try {
    if (text === null) localStorage.removeItem(name)
    else localStorage.setItem(name, text)
  } catch {
    // It is kept here.
  }
}
