// Shapes that the page's modules share: what the interface answers, what goes into elements, and what BokehJS, which
// brings no types of its own, is used for.

interface Window {
  Bokeh: any
}

/** A figure, a view, a renderer or another object of BokehJS. */
type BokehObject = any

interface BokehRange {
  start: number
  end: number
  setv(range: { start: number, end: number }): void
  change: { connect(heard: () => void): void }
}

interface BokehSource {
  data: Record<string, number[]>
}

/** An axis beside the first one. */
interface FurtherAxis {
  name: string
  range: BokehObject
}

interface PlotOptions {
  height?: number
  x?: string
  y?: string
  xRange?: BokehObject
  yRange?: BokehObject
  xLog?: boolean
  yLog?: boolean
  counted?: boolean
  names?: string[]
  select?: boolean
}

/** Columns of numbers, null where there is none. */
type Columns = Record<string, (number | null)[]>

/** A figure element with a plot in it. */
interface PlotElement extends HTMLElement {
  view?: BokehObject
  end?: () => void
  ended?: boolean
  placed?: Promise<void>
  say(text: string): void
}

// Elements.

type Child = Node | string | number | boolean | null | undefined | readonly Child[]

/** A listener of an element, which stands as the target of what it hears. */
type Heard<Kind extends Event, Target> = (event: Kind & { target: Target }) => void

type AttributeValue = string | number | boolean | null | undefined | ((event: never) => void)

/** Attributes of an element, and its listeners by the event's name. */
interface Attributes<Target> {
  click?: Heard<MouseEvent, Target>
  change?: Heard<Event, Target>
  input?: Heard<Event, Target>
  submit?: Heard<SubmitEvent, Target>
  keydown?: Heard<KeyboardEvent, Target>
  close?: Heard<Event, Target>
  toggle?: Heard<Event, Target>
  load?: Heard<Event, Target>
  error?: Heard<Event, Target>
  [name: string]: AttributeValue
}

type Control = HTMLInputElement | HTMLSelectElement | HTMLTextAreaElement

/** A choice of a select: its value and its text. */
type Choice = readonly string[]

/** A view: fills the page for the parts and the parameters of the address, until the signal is aborted. */
type View = (page: HTMLElement, parts: string[], query: URLSearchParams, signal: AbortSignal) => Promise<void>

/** A place as latitude and longitude in degrees, or as m north and east, or as a point of a drawing. */
type Point = [number, number]

// Estimates.

interface Estimate {
  value: number
  std: number
  unit?: string
}

/** A coefficient of a model. */
interface Coefficient extends Estimate {
  statistical_std?: number
  interval?: [number, number]
  ci95?: [number, number]
}

interface Refused {
  name: string
  reason: string
  manoeuvre?: string
}

interface Effect {
  name: string
  title?: string
  probability: number
  parameters?: Record<string, Coefficient>
  alternatives: { name: string, probability: number }[]
  separating_manoeuvre?: string
}

interface Model {
  coefficients: Record<string, Coefficient>
  effects?: Effect[]
}

interface ModelItem {
  id: string
  flight_id: string
  flight_name: string
  kind: 'identify' | 'discrepancy'
  job_id: string
  name: string
  created_ns: number
  verdict: 'none' | 'parameter_error' | 'missing_effect' | 'unexplained' | null
  effects: string[]
}

// Flights.

type Verdict = 'good' | 'care' | 'poor'

type JobState = 'queued' | 'running' | 'done' | 'failed' | 'skipped' | 'cancelled'

type JobKind = 'identify' | 'discrepancy' | 'design'

interface Job {
  id: string
  flight_id: string
  kind: JobKind
  state: JobState
  progress: number
  error: string | null
  created_ns: number
  owner: string
  log: string[]
}

/** What a job is asked for with: kind and settings. */
type JobRequest = { kind: JobKind } & Record<string, unknown>

/** What takes a further job into the list of a flight's jobs. */
type TakeJob = (job: Job) => void

interface Outcome {
  state: JobState | null
  verdict: Verdict | null
  text: string
}

interface Outline {
  name: string
  unit: string
  values: (number | null)[]
}

interface Flight {
  id: string
  name: string
  source: 'live' | 'upload'
  state: 'recording' | 'complete' | 'recovered'
  system: number | null
  start: string
  end: string
  duration_s: number
  vehicle_duration_s: number | null
  messages: number
  bytes: number
  end_reason: string
  follows: string | null
  parts: number
  recording_deleted: string | null
  title: string
  comment: string
  tags: string[]
  vehicle: string | null
  outcome: Outcome
  outline: Outline | null
}

interface FlightPage {
  flights: Flight[]
  next: string | null
}

interface FlightPart {
  start: number
  end: number
}

interface Mode extends FlightPart {
  mode: string
  armed: boolean
}

interface FlightText {
  time: number
  severity: number
  text: string
  note: boolean
}

interface ChosenVehicle {
  id: string | null
  name: string | null
  version: number | null
  by_hand: boolean
  why: string
  problem: string
}

/** A link that shows one flight. Times: UTC s. */
interface ShareEntry {
  id: string
  maker: string
  flight: string
  made: number
  expires: number
}

interface FlightSummary extends Flight {
  topics: Record<string, number>
  lost: number
  damage: string[]
  signals: string[]
  fields: Record<string, string[]>
  modes: Mode[]
  texts: FlightText[]
  warnings: string[]
  jobs: Job[]
  aircraft: ChosenVehicle
  used: FlightPart[]
  ground: Flight[]
}

/** What a person changes of a flight. */
type FlightChange = Partial<Pick<Flight, 'title' | 'comment' | 'tags' | 'vehicle'>>

// Signals.

interface Series {
  unit: string
  source: string
  time: number[]
  value: (number | null)[]
}

interface Spectrum {
  unit: string
  signal_unit: string
  frequency: number[]
  value: number[]
}

interface Spectrogram {
  unit: string
  signal_unit: string
  time: number[]
  frequency: number[]
  value: (number | null)[][]
}

/** A signal as it is drawn, in the unit that is shown. */
interface DrawnLine {
  name: string
  unit: string
  time: number[]
  value: number[]
}

/** A plot of signals. */
interface SignalPlot {
  element: HTMLElement
  names: string[]
  range?: BokehRange
  take?: (series: Record<string, Series>) => void
}

/** A plot of signals over time; line: the cursor's in it. */
interface TimedPlot extends SignalPlot {
  element: PlotElement
  range: BokehRange
  lines: () => DrawnLine[]
  take: (series: Record<string, Series>) => void
  line?: HTMLElement
}

/** Words of what can be done with a plot, and the doing. */
type Move = [string, () => void]

// Results of analyses.

interface Score {
  tic: number
  r2: number
  residual_mean: number
  residual_std: number
  rms_over_noise: number
  largest_over_noise: number
  gaussian_p: number
}

type Curve = {
  time_s: number[]
  measured: (number | null)[]
  predicted: (number | null)[]
}

/** What is known of the residual of one coefficient. */
interface Residual {
  autocorrelation: number[]
  lag_step_s: number
  limit: number
  histogram: { low: number, high: number, counts: number[] }
  mean: number
  std: number
}

interface ResidualSeries {
  use: 'estimation' | 'validation'
  flights?: { flight: string, axes: Record<string, Curve> }[]
  residuals?: Record<string, Residual>
  refused?: string
}

interface Fit {
  rms: number
  tic: number
}

interface Compatibility {
  compatible: boolean | null
  verdicts?: { signal: string, verdict: string, status: string }[]
  before?: Record<string, Fit>
  after?: Record<string, Fit>
}

interface FlightMode {
  name: string
  frequency_hz: Estimate | null
  damping_ratio: Estimate | null
  time_constant_s: Estimate | null
}

/** A result that says what its flights are worth. */
interface Judged {
  quality?: { verdict: Verdict, reasons: string[] }
  senders?: Record<string, { type: string, autopilot: string }>
}

interface Validation {
  flights: string[]
  outputs: Record<string, Score>
  acceptable: boolean
  outliers?: string
  reason: string
}

interface IdentificationResult extends Judged {
  model: Model
  refused: Refused[]
  sensor_errors: Record<string, Estimate>
  validation: Validation | null
  compatibility?: Compatibility
  warnings: string[]
  segments: { flight: string, start: number, end: number, kind?: string, reason?: string }[]
  series?: ResidualSeries
  modes?: FlightMode[] | { refused: string }
  dimensional?: Record<string, Estimate>
}

/** One figure of a sheet; the ends of an interval are null where they lie beyond what was looked at. */
interface SheetFigure {
  value: number | null
  unit: string
  interval?: (number | null)[] | null
}

interface Proposal {
  name: string
  now: number | null
  value: number
  unit: string
  interval: [number, number] | null
  reason: string
  refused: string
}

interface TuningSheet {
  job: string
  parameters: Proposal[]
  refused: Proposal[]
  warnings: string[]
}

interface Loop extends Record<string, any> {
  stable: boolean
  gains: Record<string, { parameter: string, now: number, may_grow: SheetFigure, oscillation: number | null }>
}

interface MarginsSheet {
  airspeed: number
  loops: Record<string, Loop>
  refused: { name: string, refused: string }[]
  handling: { mode: string, quantity: string, value: number, unit: string, level: number }[]
  warnings: string[]
}

interface PerformanceSheet {
  mass: number
  altitude: number
  figures: Record<string, (SheetFigure & { extrapolated: boolean }) | { refused: string }>
  speeds: {
    speed: number, drag: number, drag_interval?: [number, number], thrust_available?: number, extrapolated: boolean | null
  }[]
  warnings: string[]
}

/** Stages of a model in an analysis of discrepancies. */
type Stage = 'given' | 'before' | 'after'

type Use = 'estimation' | 'validation'

/** The gap of each output at each stage. */
type Gap = Record<string, Record<string, number>>

interface SimulatedFlight {
  flight: string
  time_s: number[]
  outputs: Record<string, Record<string, (number | null)[]>>
}

interface Disagreement {
  axis: string
  variable: string
  share: number
  p_value: number
  curve?: { value: number, residual: number, std: number }[]
}

interface DiscrepancyResult extends Judged {
  verdict: string
  sentence: string
  warnings?: string[]
  effects: Effect[]
  gap: Record<string, Gap | null>
  series?: Record<string, SimulatedFlight[] | null>
  where: Disagreement[]
  reasons?: string[]
  ruled_out?: string[]
}

interface Segment {
  manoeuvre: string
  duration: number
  width?: number
  amplitude?: number
  amplitudes?: Record<string, number>
}

interface DesignResult {
  vehicle: string
  model: string
  method: string
  duration_s: number
  gusts: number
  trim?: { V: number }
  plan: { segments: Segment[] }
  excursions: Record<string, [number, number]>
  warnings: string[]
  files: Record<string, string>
  coefficients: { name: string, value: number, std: number, percent: number | null }[]
  refused: Refused[]
}

/** What a flight was planned to give, beside what it gave. */
interface Planned {
  flight: string
  made: string
  gusts: number
  coefficients: { name: string, expected_std: number | null, reached_std: number | null }[]
}

// Aircraft.

interface Servo {
  servo: number
  pwm_us: number[]
  travel: number[]
  mix: number
}

interface AircraftControl {
  signal: string
  servos: Servo[]
}

interface BenchTable {
  source: string
  form: string
  unit: string
  points: number[][]
}

/** What the form of an aircraft asks. */
interface AircraftForm {
  name: string
  numbers: Record<string, number>
  controls: Record<string, AircraftControl>
  places: Record<string, number[]>
  bench: Record<string, BenchTable>
}

interface AircraftDraft {
  toml: string
  form?: AircraftForm
}

interface Figure {
  name: string
  value: number
  unit: string
  usual: [number, number]
  is_usual: boolean
}

/** What a vehicle file says, and what follows from it. */
interface AircraftReading {
  problem: string
  name: string
  toml: string
  form: AircraftForm | null
  sketch: string
  warnings: string[]
  figures: Figure[]
}

interface Aircraft {
  id: string
  name: string
  version: number
  versions: number[]
  editable: boolean
  changed: string
  mass_kg: number
  span_m: number
  warnings: string[]
  reading: AircraftReading
}

/** A coefficient of an aircraft over its flights. */
interface Trend {
  name: string
  estimates: { flight: string, title: string, start: string, value: number, std: number }[]
  mean: number
  std: number
  constant_p: number
  change: { flight: string, before: number, before_std: number, after: number, after_std: number, p: number } | null
}

// What the vehicle does now.

interface LinkComponent {
  component: number
  received: number
  duplicates: number
  lost: number
  loss: number
}

interface Link {
  url: string
  connected: boolean
  problem: string
  frames_per_s: number
  bytes_per_s: number
  raw_bytes: number
  bad_crc: number
  systems: { system: number, components: LinkComponent[] }[]
}

interface Health {
  version: string
  links_connected: number
  links_total: number
  disk_free_bytes: number
  problem: string
}

interface Battery {
  voltage_v?: number
  current_a?: number
  remaining?: number
}

interface Gps {
  fix: string
  good: boolean
  satellites?: number | null
}

interface Wind {
  north: number
  east: number
}

/** A text of the vehicle, or a note. */
interface LiveText {
  time_s: number | null
  text: string
  severity?: number
  note?: boolean
}

/** The vehicle's own state, as far as it says it. */
interface VehicleStatus {
  mode?: string
  armed?: boolean
  battery?: Battery
  gps?: Gps
  ground_speed?: number
  position?: Point
  home?: { place: Point, given: boolean }
  wind?: Wind
  texts?: LiveText[]
}

interface LiveCoefficient extends Coefficient {
  known: boolean
  why?: string
  fly?: string
}

interface LiveEstimate {
  coefficients: Record<string, LiveCoefficient>
  sensors?: Record<string, Estimate>
  nuisances?: { name: string, text: string, estimated: boolean, shown: Estimate }[]
  latency_ms?: { median: number, p95: number }
  cpu_share?: number
  updates_per_s: number
  events?: { text: string }[]
  warnings?: string[]
}

interface LiveSignal {
  value: number
  unit: string
  age_s: number
}

/** Whether somebody flies, and which flight that is. */
interface LiveState {
  state: 'waiting' | 'live' | 'lost'
  flight?: string | null
  vehicle?: string | null
  landed?: string | null
  silent?: string | null
}

/** GET /api/live */
interface Live extends LiveState {
  time_s: number | null
  signals: Record<string, LiveSignal>
  status: VehicleStatus
  track: Point[]
  identification: LiveEstimate | null
  why: string | null
}

/** An event of the stream: the newest value of each signal, and the times and values since the one before. */
interface SignalsEvent {
  time_s: number | null
  signals: Record<string, number | null>
  samples?: Record<string, [number[], (number | null)[]]>
}

/** GET /api/live/minute */
interface Minute {
  flight: string | null
  time_s: number[]
  signals: Record<string, (number | null)[]>
}

interface StationMap {
  least_zoom: number
  most_zoom: number
  attribution: string
}

/** A cell of a table whose figures move: a text, or a text and a class. */
type LiveCell = string | [string, string]

/** A row of such a table: its name, and its cells. */
type LiveRow = [string, ...LiveCell[]]

/** What a coefficient was from estimate to estimate, with its 95 % band. */
type LiveBand = {
  x: number[]
  y: number[]
  low: number[]
  high: number[]
}

/** What is known for the line of what may end a flight. */
interface LiveKnown {
  status: VehicleStatus
  links: Link[] | null
  health: Health | null
  flight?: string | null
  old: boolean
}
