// The REST interface: requests, errors in words, downloads.

/** What the service or the network said, as a sentence. */
export class Problem extends Error {
  /** @param {number} status @param {string} detail */
  constructor(status, detail) {
    super(detail)
    this.status = status
  }
}

/** What went wrong, in words. @param {unknown} error whatever was thrown */
export const sentence = error => error instanceof Error ? error.message : String(error)

/** Whether something ended because nobody waits for it any more. @param {unknown} error whatever was thrown */
export const aborted = error => error instanceof Error && error.name === 'AbortError'

/**
 * The status of the answer that is a problem; undefined of any other error.
 * @param {unknown} error whatever was thrown
 */
export const statusOf = error => error instanceof Problem ? error.status : undefined

/** The detail of an answer that is an error. @param {Response} answer */
export async function problemOf(answer) {
  const text = await answer.text()
  return new Problem(answer.status, detailOf(text) ?? `the ground station answered ${answer.status}`)
}

/** The sentence of a problem's JSON; null where it is none. @param {string} text @returns {string | null} */
export function detailOf(text) {
  try {
    return JSON.parse(text).detail ?? null
  } catch {
    return null
  }
}

/**
 * A fetch from this service; throws Problem for every answer that is none.
 * @param {string} path
 * @param {RequestInit} [options]
 */
export async function request(path, options = {}) {
  let answer
  try {
    answer = await fetch(path, options)
  } catch (error) {
    if (aborted(error)) throw error
    throw new Problem(0, 'the ground station does not answer; is it running, and is this device on its network?')
  }
  if (!answer.ok) throw await problemOf(answer)
  return answer
}

/**
 * Parameters of a request; numbers may stand among them, and what is empty is left out.
 * @param {Record<string, string | number | null | undefined>} parameters
 */
export const asking = parameters => new URLSearchParams(Object.entries(parameters)
  .filter(([, value]) => value !== '' && value !== null && value !== undefined).map(([name, value]) =>
    [name, String(value)]))

/** @param {string} path @param {AbortSignal} [signal] */
export const get = async (path, signal) => (await request(path, { signal })).json()

/**
 * @param {string} method
 * @returns {(path: string, body: object) => Promise<any>} whose answer is the JSON of the address
 */
const sent = method => async (path, body) => (await request(path, {
  method, headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(body),
})).json()

export const post = sent('POST')
export const put = sent('PUT')
export const patch = sent('PATCH')

/** Delete what is at the address. @param {string} path */
export const remove = path => request(path, { method: 'DELETE' })

/**
 * The same as get, but null where there is nothing at the address yet.
 * @param {string} path
 * @param {AbortSignal} [signal]
 */
export async function getIfThere(path, signal) {
  try {
    return await get(path, signal)
  } catch (error) {
    if (statusOf(error) === 404) return null
    throw error
  }
}

/**
 * Send a file; progress(share) is called while it goes. Resolves to the answer's JSON.
 * @param {File} file
 * @param {string} columns
 * @param {(share: number) => void} progress
 * @param {AbortSignal} [signal]
 * @returns {Promise<Flight & { note: string }>}
 */
export const upload = (file, columns, progress, signal) => new Promise((resolve, reject) => {
  const sending = new XMLHttpRequest()
  sending.open('POST', `/api/flights?${new URLSearchParams({ name: file.name, ...(columns.trim() && { columns }) })}`)
  sending.setRequestHeader('Content-Type', 'application/octet-stream')
  sending.upload.onprogress = event => progress(event.total ? event.loaded / event.total : 0)
  sending.onload = () => sending.status < 300 ? resolve(JSON.parse(sending.responseText)) : reject(
    new Problem(sending.status, detailOf(sending.responseText) ?? `the ground station answered ${sending.status}`))
  sending.onerror = () => reject(new Problem(0, 'the connection broke while the file was sent; send it again'))
  signal?.addEventListener('abort', () => sending.abort())
  sending.send(file)
})

/** Hand a blob to the user as a file of that name. @param {Blob} blob @param {string} name */
export function hand(blob, name) {
  const address = URL.createObjectURL(blob)
  Object.assign(document.createElement('a'), { href: address, download: name }).click()
  setTimeout(() => URL.revokeObjectURL(address), 60_000)
}
