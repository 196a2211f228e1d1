// Numbers as people read them: degrees for radians, as many digits as the standard error warrants.

const DEGREES = 180 / Math.PI
/** @type {Record<string, [string, number]>} */
const SHOWN = { rad: ['°', DEGREES], 'rad/s': ['°/s', DEGREES], 'm/s^2': ['m/s²', 1], 'kg/m^3': ['kg/m³', 1],
  deg: ['°', 1], 'deg/s': ['°/s', 1], 'g m^2': ['g m²', 1] }
/** @type {Record<string, string>} */
const SYMBOLS = {
  alpha: 'α', beta: 'β', phi: 'φ roll', theta: 'θ pitch', psi: 'ψ heading', V: 'V', airspeed: 'airspeed',
  de: 'elevator', da: 'aileron', dr: 'rudder', p: 'p roll rate', q: 'q pitch rate', r: 'r yaw rate',
}
export const NONE = '–'

/** The unit to show for one of SI, and the factor to it. @param {string | null} [unit] @returns {[string, number]} */
export const shownUnit = unit => SHOWN[unit ?? ''] ?? [unit ?? '', 1]

/** A signal's name as a heading of plots. @param {string} name */
export const signalName = name => SYMBOLS[name] ?? name

/**
 * Three significant digits or `digits` of a number; a dash for none.
 * @param {number | null} [value]
 * @param {number} [digits]
 */
export function number(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return NONE
  if (value === 0) return '0'
  const size = Math.abs(value)
  const text = size < 1e-4 || size >= 1e6 ? value.toExponential(digits - 1)
    : value.toFixed(Math.min(8, Math.max(0, digits - 1 - Math.floor(Math.log10(size)))))
  return text.replaceAll('-', '−')
}

/** A value with the decimals that two digits of its standard error take. @param {number} value @param {number} std */
export function estimate(value, std) {
  if (!Number.isFinite(value)) return NONE
  if (!(std > 0)) return number(value, 4)
  const decimals = 1 - Math.floor(Math.log10(std))
  return decimals > 8 ? number(value, 6) : value.toFixed(Math.max(0, decimals)).replace('-', '−')
}

/** value ± standard error, both to the same decimals. @param {Estimate} entry */
export const plusMinus = entry =>
  entry.std > 0 ? `${estimate(entry.value, entry.std)}\u00a0±\u00a0${estimate(entry.std, entry.std)}`
    : number(entry.value, 4)

/**
 * The 95 % interval of an estimate; null where it has none.
 * @param {Coefficient} entry
 * @returns {[number, number] | null}
 */
export function interval(entry) {
  const given = entry.interval ?? entry.ci95
  if (given) return given
  return Number.isFinite(entry.std) ? [entry.value - 1.96 * entry.std, entry.value + 1.96 * entry.std] : null
}

/** A p value; what underflow left as zero is below what can be shown. @param {number} value */
export const chance = (value, digits = 2) =>
  Number.isFinite(value) && value < 1e-300 ? 'below 10⁻³⁰⁰' : number(value, digits)

/** A probability, certain to no more digits than it is. @param {number} share */
export const probability = share => share > 0.999 ? 'over 99.9 %' : percent(share)

/** @param {number} share */
export const percent = share => `${number(100 * share, 2)} %`

/** Seconds as h min s. @param {number} seconds */
export function duration(seconds) {
  if (!Number.isFinite(seconds)) return NONE
  const whole = Math.round(seconds)
  const [hours, minutes, rest] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60]
  if (hours) return `${hours}\u00a0h ${minutes}\u00a0min`
  return minutes ? `${minutes}\u00a0min ${rest}\u00a0s` : `${number(seconds, 3)}\u00a0s`
}

/** Bytes as kB, MB or GB. @param {number} bytes */
export const size = bytes =>
  bytes >= 1e9 ? `${number(bytes / 1e9)} GB` : bytes >= 1e6 ? `${number(bytes / 1e6)} MB` : `${number(bytes / 1e3)} kB`

/** 2026-11-22T09:09:50.942Z as 2026-11-22 09:09:50. @param {string | null} [text] */
export const utc = text => text && text >= '2000' ? text.slice(0, 19).replace('T', ' ') : NONE
