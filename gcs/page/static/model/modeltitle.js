// How a model is called in lists: the flight it comes from, and what was done for it.

import { utc } from '../shared/format.js'

/** What an analysis made of the model that it was given. @param {ModelItem} model */
function judged({ verdict, effects }) {
  if (verdict === 'missing_effect') return `${effects.join(' and ')} added`
  if (verdict === 'parameter_error') return 'coefficients corrected'
  if (verdict === 'unexplained') return 'questioned: unexplained, nothing added'
  return 'questioned: nothing missing'
}

/** flight, kind and verdict; the name of the model too where `named`. @param {ModelItem} model */
export function modelTitle(model, named = false) {
  const what = model.kind === 'discrepancy' ? judged(model) : 'identified'
  const when = utc(new Date(model.created_ns / 1e6).toISOString()).slice(0, 16)
  return `${named && model.name ? `${model.name}, ` : ''}${model.flight_name}, ${what} ${when}`
}
