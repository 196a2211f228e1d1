// What a vehicle file says and what follows from it, with the picture that shows a wrong unit.

import { h, listing, remark, table } from '../shared/dom.js'
import { number } from '../shared/format.js'

/**
 * What a vehicle file says, and the picture that shows a wrong unit. begun: whether anything was entered yet.
 * @param {AircraftReading} found
 */
export function reading(found, begun = true) {
  if (found.problem) return remark(begun ? 'bad' : 'note',
    h('p', {}, begun ? found.problem
      : `What follows from the form stands here as you fill it in; so far: ${found.problem}`))
  const picture = h('img',
    { class: 'sketch', src: `data:image/svg+xml;charset=utf-8,${encodeURIComponent(found.sketch)}`,
      alt: `${found.name} from above and from the front, to scale, beside a sheet of A4` })
  /** @param {Figure} figure */
  const row = figure =>
    [figure.name, `${number(figure.value)} ${shown(figure.unit)}`.trim(), `${figure.usual[0]} to ${figure.usual[1]}`,
      figure.is_usual ? '' : h('strong', {}, 'unusual: is a unit wrong?')]
  return h('div', { class: 'pair' },
    h('div', {}, found.warnings.length ? remark('note', h('h2', {}, 'Doubtful'), listing(found.warnings)) : null,
      table('What follows from it', ['Figure', 'Value', 'Small aircraft', 'Remark'], found.figures.map(row))),
    h('figure', {}, picture, h('figcaption', {}, 'Drawn to scale from what was entered; broken lines are guesses.')))
}

/** @param {string} unit */
const shown = unit => unit.replaceAll('^2', '²')
