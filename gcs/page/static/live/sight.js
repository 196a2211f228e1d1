// Draws what is on the screen alone: a plot that is scrolled away costs as much as one that is seen.

export class Sight {
  /** signal: when it is aborted, nothing is watched any more. @param {AbortSignal} signal */
  constructor(signal) {
    /** @type {Set<Element>} */
    this.seen = new Set()
    /** @type {Map<Element, () => void>} */
    this.drawn = new Map()
    this.observer = new IntersectionObserver(entries => {
      for (const { target, isIntersecting } of entries) {
        if (!isIntersecting) this.seen.delete(target)
        else if (this.drawn.has(target)) {
          this.seen.add(target)
          this.drawn.get(target)?.()
        }
      }
    })
    signal.addEventListener('abort', () => this.observer.disconnect())
  }

  /** Watch an element; draw is called when it comes into sight. @param {Element} element @param {() => void} draw */
  watch(element, draw) {
    this.drawn.set(element, draw)
    this.observer.observe(element)
  }

  /** @param {Element} element */
  forget(element) {
    this.observer.unobserve(element)
    this.drawn.delete(element)
    this.seen.delete(element)
  }

  /** @param {Element} element */
  has(element) {
    return this.seen.has(element)
  }
}
