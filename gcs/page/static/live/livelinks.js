// The links and what is lost on them.

import { h, remark } from '../shared/dom.js'
import { NONE, number, percent } from '../shared/format.js'
import { LiveTable } from './livetable.js'

const HEAD = ['Link', 'State', 'Messages/s', 'kB/s', 'Lost', 'Bad checksums', 'Stray bytes', 'Vehicles']

/** The section of links. */
export class Links {
  constructor() {
    this.table = new LiveTable('What comes on each link, and what is lost', HEAD, ['', '', ...HEAD.slice(2)],
      name => name)
    this.notes = h('div', {})
    this.noted = ''
    this.elements = [h('h2', {}, 'Links'), this.table.element, this.notes]
  }

  /** Take links as GET /api/links gives them. @param {Link[]} found */
  show(found) {
    this.table.element.classList.remove('old')
    this.table.show(found.map(row))
    const problems = found.filter(link => link.problem).map(link => `${link.url}: ${link.problem}`)
    this.note(found.length ? problems.join('\n') : 'none', () => found.length ? problems.map(trouble)
      : [remark('note', h('p', {}, 'The ground station was started without a link. Start it again with one, as in '),
        h('p', {}, h('code', {}, 'gcs serve --connect udpin:0.0.0.0:14550 --vehicle mine.toml')))])
  }

  /**
   * The links could not be asked for: what was known of them stays, but not as if it were new.
   * @param {string} reason
   */
  fail(reason) {
    this.table.element.classList.add('old')
    const text = this.table.element.hidden ? reason : `${reason}. The figures of the links are old.`
    this.note(text, () => [trouble(text)])
  }

  /** @param {string} text @param {() => HTMLElement[]} nodes */
  note(text, nodes) {
    if (text === this.noted) return
    this.noted = text
    this.notes.replaceChildren(...nodes())
  }
}

/** @param {string} text */
const trouble = text => remark('bad', h('p', {}, text))

/** @param {Link} link @returns {LiveRow} */
function row(link) {
  const components = link.systems.flatMap(system => system.components)
  const [lost, received] = /** @type {const} */ (['lost', 'received']).map(key =>
    components.reduce((sum, one) => sum + one[key], 0))
  const state = !link.connected ? 'not connected' : link.frames_per_s > 0 ? 'receiving' : 'silent'
  return [
    link.url, [state, `state ${state.split(' ')[0]}`], number(link.frames_per_s), number(link.bytes_per_s / 1000),
    received ? percent(lost / (lost + received)) : NONE, String(link.bad_crc), String(link.raw_bytes),
    [...new Set(link.systems.map(system => system.system))].join(', ') || 'none heard',
  ]
}
