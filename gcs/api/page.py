"""The plain page: flights and links, read from the REST interface by the browser."""

PAGE = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<title>Ground station</title>
<style>
body { font: 15px system-ui, sans-serif; margin: 2rem; max-width: 60rem }
table { border-collapse: collapse; width: 100% }
th, td { text-align: left; padding: .3rem .6rem; border-bottom: 1px solid #ccc }
</style>
<h1>Ground station</h1>
<p id="state"></p>
<form id="login" hidden><label>Token <input type="password" id="token"></label> <button>Open</button></form>
<table><thead><tr><th>Flight</th><th>Start (UTC)</th>
<th>Duration</th><th>Messages</th><th>State</th><th></th></tr></thead>
<tbody id="flights"></tbody></table>
<p><a href="/docs">Description of the interface</a></p>
<script>
const get = path => fetch(path, {headers: sessionStorage.token ?
  {Authorization: 'Bearer ' + sessionStorage.token} : {}})
async function report(id) {
  const page = window.open('', '_blank')
  const answer = await get(`/api/flights/${id}/report`)
  if (!answer.ok) { page.close(); alert((await answer.json()).detail); return }
  page.location = URL.createObjectURL(await answer.blob())
}
async function show() {
  const answer = await get('/api/flights')
  document.getElementById('login').hidden = answer.status !== 401
  if (!answer.ok) { document.getElementById('state').textContent = (await answer.json()).detail; return }
  const health = await (await get('/api/health')).json()
  document.getElementById('state').textContent =
    `${health.links_connected} of ${health.links_total} links connected` + (health.problem ? ': ' + health.problem : '')
  const rows = (await answer.json()).flights.map(flight => {
    const row = document.createElement('tr')
    for (const text of [flight.id, flight.start, flight.duration_s.toFixed(1) + ' s', flight.messages, flight.state])
      row.insertCell().textContent = text
    const button = document.createElement('button')
    button.textContent = 'Report'
    button.onclick = () => report(flight.id)
    row.insertCell().append(button)
    return row
  })
  document.getElementById('flights').replaceChildren(...rows)
}
document.getElementById('login').onsubmit = event => {
  event.preventDefault()
  sessionStorage.token = document.getElementById('token').value
  show()
}
show()
setInterval(show, 2000)
</script>
</html>
"""
