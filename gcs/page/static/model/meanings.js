// What a coefficient is, in plain words: as gcs.text.meanings has it.

/** @type {Record<string, string>} */
const AXES = { CL: 'lift', CD: 'drag', CY: 'side force', Cl: 'rolling moment', Cm: 'pitching moment',
  Cn: 'yawing moment' }
/** @type {Record<string, string>} */
const REGRESSORS = {
  alpha: 'angle of attack', alphadot: 'rate of the angle of attack', beta: 'sideslip', p: 'roll rate', q: 'pitch rate',
  r: 'yaw rate',
  de: 'elevator', da: 'aileron', dr: 'rudder', CL: 'lift', throttle: 'throttle',
}
/** @type {Record<string, string>} */
const POWERS = { '': '', 2: ' squared', 3: ' cubed', 4: ' to the fourth' }
/** @type {Record<string, string>} */
const CALLED = {
  CL_alpha: 'lift slope', Cm_alpha: 'pitch stability', Cm_q: 'pitch damping', Cm_de: 'elevator power',
  Cl_beta: 'dihedral effect',
  Cl_p: 'roll damping', Cl_da: 'aileron power', Cn_beta: 'weathercock stability', Cn_r: 'yaw damping',
  Cn_dr: 'rudder power',
  Cn_da: 'adverse yaw', CD_k: 'induced drag',
}

/**
 * @param {string} name
 * @returns {string} as "pitch damping: pitching moment by pitch rate"; empty for what is no coefficient
 */
export function meaning(name) {
  const [axis, ...rest] = (name === 'CD_k' ? 'CD_CL2' : name).split('_')
  const factors = rest.map(one => one.match(/^([A-Za-z]+?)([2-4]?)$/)).map(one =>
    one && REGRESSORS[one[1]] && REGRESSORS[one[1]] + POWERS[one[2]])
  // A control of another name, as flap or left_motor, stands last.
  const first = factors.findIndex(one => !one)
  const control = rest.slice(first).join(' ')
  if (first >= 0 && /^[A-Za-z][A-Za-z0-9 ]*$/.test(control)) factors.splice(first, rest.length, control)
  if (!AXES[axis] || !rest.length) return ''
  if (rest[0] === '0' && rest.length === 1) return `${AXES[axis]} at zero angles and rates`
  if (factors.some(one => !one)) return ''
  const words = `${AXES[axis]} by ${factors.join(' times ')}`
  return CALLED[name] ? `${CALLED[name]}: ${words}` : words
}
