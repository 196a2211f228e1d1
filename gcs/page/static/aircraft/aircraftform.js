// The form of an aircraft: what one measures with a scale, a ruler and a watch.

import { field, h, select } from '../shared/dom.js'
import { swings } from './pendulum.js'

/** @type {Record<string, string>} */
const CONTROLS = { elevator: 'Elevator', aileron: 'Ailerons', rudder: 'Rudder', throttle: 'Throttle' }
// The servo outputs that are usual.
/** @type {Record<string, number>} */
const OUTPUTS = { elevator: 2, aileron: 1, rudder: 4 }
const SENSORS = {
  alpha_vane: 'Angle-of-attack vane', beta_vane: 'Sideslip vane', accelerometer: 'Accelerometer (the autopilot)',
}
const CHANNELS = [['alpha', 'angle of attack'], ['beta', 'sideslip'], ['airspeed', 'airspeed'], ['thrust', 'thrust']]

/** Its parts, which write what is entered into `form` and call changed() then. */
export class Form {
  /** @param {AircraftForm} form @param {() => void} changed */
  constructor(form, changed) {
    this.form = form
    this.changed = changed
    /** @type {Record<string, HTMLInputElement>} */
    this.inputs = {}
    this.elements = [this.basics(), this.inertia(), this.controls(), this.motor(), this.places(), this.bench()]
  }

  /** Put numbers that were worked out into their fields. @param {Record<string, number>} made */
  take(made) {
    for (const [name, value] of Object.entries(made)) {
      this.form.numbers[name] = value
      this.inputs[name].value = String(value)
    }
    this.changed()
  }

  /**
   * A field of a number that is kept in form.numbers; empty takes it out.
   * @param {string} name
   * @param {string} label
   * @param {string} unit
   * @param {string} [hint]
   */
  figure(name, label, unit, hint) {
    const input = h('input',
      { type: 'number', step: 'any', inputmode: 'decimal', value: this.form.numbers[name] ?? null, input: () => {
        if (input.value === '') delete this.form.numbers[name]
        else this.form.numbers[name] = Number(input.value)
        this.changed()
      } })
    this.inputs[name] = input
    return field(`${label}, ${unit}`, input, hint)
  }

  basics() {
    const name = h('input', { type: 'text', required: true, maxlength: 100, value: this.form.name, input: () => {
      this.form.name = name.value
      this.changed()
    } })
    return h('fieldset', { class: 'panel grid' }, h('legend', {}, 'With a scale and a ruler'),
      field('Name', name, 'As it is called at the field'), this.figure('mass_kg', 'Mass, ready to fly', 'kg'),
      this.figure('mass_std_kg', 'The scale is good to', 'kg', '1 sigma; may stay empty'),
      this.figure('span_m', 'Span, tip to tip', 'm'),
      this.figure('area_m2', 'Wing area', 'm²',
        'Of the whole planform, through the fuselage; span times mean chord where this stays empty'),
      this.figure('chord_m', 'Mean chord', 'm', 'Wing area over span where this stays empty'),
      this.figure('speed_mps', 'Airspeed in cruise', 'm/s', 'May stay empty'))
  }

  inertia() {
    const entries = ['Ixx', 'Iyy', 'Izz'].map(key =>
      h('div', {}, this.figure(`${key}_kgm2`, key, 'kg m²'), this.figure(`${key}_std_kgm2`, `± of ${key}`, 'kg m²')))
    return h('fieldset', { class: 'panel' }, h('legend', {}, 'Moments of inertia'),
      h('p', {}, 'Leave all three empty, and those usual for span and mass are taken, to 70 %: lift and drag hardly '
        + 'suffer, moments are known no better.'),
      h('div', { class: 'grid' }, entries, this.figure('Ixz_kgm2', 'Ixz', 'kg m²', 'May stay empty')),
      swings(this.form.numbers, made => this.take(made)))
  }

  controls() {
    return h('fieldset', { class: 'panel' }, h('legend', {}, 'Controls'),
      h('p', {}, 'Hold the surface at a few deflections, read pulse and angle. Leave a control out where the log '
        + 'holds the autopilot’s parameters: its servo is then found there, its travel guessed to 30 %, and what it '
        + 'does is known no better.'),
      [...new Set([...Object.keys(CONTROLS), ...Object.keys(this.form.controls)])].map(name => this.control(name)),
      this.another())
  }

  /** A control of another name, as a flap or one of two motors. */
  another() {
    const name = h('input', { type: 'text', placeholder: 'flap', pattern: '[A-Za-z][A-Za-z0-9_]*' })
    const add = h('button', { type: 'button', click: () => {
      const chosen = name.value.trim()
      if (!name.reportValidity() || !chosen || chosen in this.form.controls) return
      this.form.controls[chosen] = { signal: 'command', servos: [newServo(chosen)] }
      name.value = ''
      row.before(this.control(chosen))
      this.changed()
    } }, 'Add a control')
    const row = h('div', { class: 'row' },
      field('Another control', name, 'A flap, a spoiler, one of two motors: its name in the coefficients'), add)
    return row
  }

  /** @param {string} name @returns {HTMLElement} */
  control(name) {
    const given = this.form.controls[name]
    const box = h('input', { type: 'checkbox', checked: Boolean(given), change: () => {
      if (box.checked) this.form.controls[name] = { signal: 'command', servos: [newServo(name)] }
      else delete this.form.controls[name]
      again()
    } })
    // Drawn anew alone, the focus left where it was.
    const again = () => {
      const drawn = this.control(name)
      place.replaceWith(drawn)
      drawn.querySelector('input')?.focus()
      this.changed()
    }
    const called = CONTROLS[name] ?? name
    const title = h('label', { class: 'choice' }, box, called)
    const place = h('div', { class: 'control', role: 'group', 'aria-label': `${called}: servos` }, title)
    if (!given) return place
    const signal = select([['command', 'the command sent to the servo'], ['position', 'its measured position']],
      given.signal, value => {
        given.signal = value
        this.changed()
      })
    place.append(...given.servos.map((servo, index) => this.servo(name, given, servo, index, again)),
      h('div', { class: 'row' }, h('button', { type: 'button', click: () => {
        given.servos.push(newServo(name))
        given.servos.forEach(one => { one.mix = 1 / given.servos.length })
        again()
      } }, 'Another servo moves it too')),
      field('The log carries', signal))
    return place
  }

  /**
   * @param {string} name
   * @param {AircraftControl} given
   * @param {Servo} servo
   * @param {number} index
   * @param {() => void} again
   */
  servo(name, given, servo, index, again) {
    /** @param {'pwm_us' | 'travel'} key @param {string} label @param {string | null} [hint] */
    const list = (key, label, hint) => {
      const input = h('input', { type: 'text', inputmode: 'decimal', value: servo[key].join(', '), input: () => {
        servo[key] = input.value.split(/[\s,;]+/).filter(Boolean).map(Number)
        input.setCustomValidity(servo[key].some(value => !Number.isFinite(value)) ? 'numbers with commas between' : '')
        this.changed()
      } })
      return field(label, input, hint)
    }
    /** @param {'servo' | 'mix'} key @param {string} label @param {string} hint */
    const figure = (key, label, hint) => {
      const input = h('input', { type: 'number', step: 'any', value: servo[key], input: () => {
        servo[key] = Number(input.value)
        this.changed()
      } })
      return field(label, input, hint)
    }
    const several = given.servos.length > 1
    return h('div', { class: 'grid' }, figure('servo', 'Servo output', 'From 1 to 48: AUX 1 is 17'),
      list('pwm_us', 'Pulses, µs'),
      list('travel', name === 'throttle' ? 'Throttle there, %'
        : name in CONTROLS ? 'Deflection there, °' : 'Value there',
        name === 'throttle' ? null : name in CONTROLS ? 'The sign is yours: keep it the same always'
          : 'In radians, or as a share of its travel: coefficients are per unit of it'),
      several && figure('mix', 'Share', 'Of its deflection in the control’s'),
      several && h('button', { type: 'button', 'aria-label': `Leave servo ${servo.servo} out`, click: () => {
        given.servos.splice(index, 1)
        if (given.servos.length === 1) given.servos[0].mix = 1
        again()
      } }, 'Leave it out'))
  }

  motor() {
    return h('fieldset', { class: 'panel grid' }, h('legend', {}, 'Motor'),
      this.figure('max_thrust_n', 'Largest static thrust', 'N', 'By a spring balance; may stay empty'),
      this.figure('propeller_m', 'Propeller’s diameter', 'm', 'Only together with the thrust'),
      this.figure('moving_mass_kg', 'Mass on the thrust sensor', 'kg',
        'Motor and propeller, where a sensor measures thrust; only together with the thrust'))
  }

  places() {
    /** @param {string} name @param {string} label */
    const place = (name, label) => {
      const input = h('input',
        { type: 'text', value: this.form.places[name]?.join(', ') ?? '', placeholder: '0.1, 0.5, 0', input: () => {
          const values = input.value.split(/[\s,;]+/).filter(Boolean).map(Number)
          if (!values.length) delete this.form.places[name]
          else this.form.places[name] = values
          this.changed()
        } })
      return field(label, input)
    }
    return h('fieldset', { class: 'panel' }, h('legend', {}, 'Where sensors are'),
      h('p', {}, 'From the centre of gravity, m: forward, right, down. Empty where there is none, or it sits at the '
        + 'centre of gravity.'),
      h('div', { class: 'grid' }, Object.entries(SENSORS).map(([name, label]) => place(name, label))))
  }

  bench() {
    const names = Object.keys(this.form.bench)
    const again = () => {
      const drawn = this.bench()
      place.replaceWith(drawn)
      const first = /** @type {HTMLElement | null} */ (drawn.querySelector('input, button'))
      first?.focus()
      this.changed()
    }
    const place = h('fieldset', { class: 'panel' }, h('legend', {}, 'Bench tables of analogue channels'),
      names.map(name => this.table(name, again)),
      h('div', { class: 'row' }, CHANNELS.filter(([name]) => !names.includes(name)).map(([name, words]) =>
        h('button', { type: 'button', click: () => {
          this.form.bench[name] = { source: 'adc0', form: name === 'airspeed' ? 'pitot' : 'linear',
            unit: { airspeed: 'Pa', thrust: 'gf' }[name] ?? 'deg', points: [] }
          again()
        } }, `Add ${words}`))))
    return place
  }

  /** @param {string} name @param {() => void} again */
  table(name, again) {
    const given = this.form.bench[name]
    /** @param {'source' | 'form' | 'unit'} key @param {string} label @param {string} hint */
    const short = (key, label, hint) => {
      const input = h('input', { type: 'text', value: given[key], input: () => {
        given[key] = input.value.trim()
        this.changed()
      } })
      return field(label, input, hint)
    }
    const read = h('p', { class: 'hint', role: 'status' })
    const points = h('textarea', { rows: 5, class: 'code', input: () => {
      const lines = points.value.split('\n').filter(line => line.trim())
      given.points = lines.map(line => line.split(/[\s,;]+/).filter(Boolean).slice(0, 2).map(Number)).filter(row =>
        row.length === 2 && row.every(Number.isFinite))
      const left = lines.length - given.points.length
      read.textContent = `${given.points.length} points `
        + `read${left ? `; ${left} lines left out, which are no two numbers` : ''}`
      this.changed()
    } })
    points.value = given.points.map(row => row.join(', ')).join('\n')
    return h('div', { class: 'control', role: 'group', 'aria-label': name }, h('h3', {}, name),
      h('div', { class: 'grid' },
        short('source', 'Channel', 'As adc0'), short('form', 'Curve', 'linear, polynomial:2, spline, pitot'),
        short('unit', 'Unit of the reference', 'Pa, mmH2O, N, gf, deg, rad')),
    field('Reference and reading, one pair a line', points, 'Paste two columns of a spreadsheet'), read,
    h('button', { type: 'button', click: () => {
      delete this.form.bench[name]
      again()
    } }, `Leave ${name} out`))
  }
}

/** @param {string} name @returns {Servo} */
const newServo = name => name === 'throttle' ? { servo: 3, pwm_us: [1100, 1900], travel: [0, 100], mix: 1 }
  : name in CONTROLS ? { servo: OUTPUTS[name], pwm_us: [1100, 1500, 1900], travel: [-20, 0, 20], mix: 1 }
    : { servo: 5, pwm_us: [1100, 1900], travel: [0, 1], mix: 1 }
