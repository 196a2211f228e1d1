// The links and what is lost on them.

import { h, remark, table } from './dom.js'
import { NONE, number, percent } from './format.js'

/** Nodes that tell of links as GET /api/links gives them. */
export function links(found) {
  if (!found.length) {
    return [remark('note', h('p', {}, 'The ground station was started without a link. Start it again with one, as in '),
      h('p', {}, h('code', {}, 'gcs serve --connect udpin:0.0.0.0:14550 --vehicle mine.toml')))]
  }
  const head = ['Link', 'State', 'Messages/s', 'kB/s', 'Lost', 'Bad checksums', 'Stray bytes', 'Vehicles']
  const notes = found.filter(link => link.problem).map(link => remark('bad', h('p', {}, `${link.url}: ${link.problem}`)))
  return [table('Links', head, found.map(row)), ...notes]
}

function row(link) {
  const components = link.systems.flatMap(system => system.components)
  const [lost, received] = ['lost', 'received'].map(key => components.reduce((sum, one) => sum + one[key], 0))
  const state = !link.connected ? 'not connected' : link.frames_per_s > 0 ? 'receiving' : 'silent'
  return [
    link.url, h('span', { class: `state ${state.split(' ')[0]}` }, state), number(link.frames_per_s), number(link.bytes_per_s / 1000),
    received ? percent(lost / (lost + received)) : NONE, String(link.bad_crc), String(link.raw_bytes),
    link.systems.map(system => system.system).join(', ') || 'none heard',
  ]
}
