// Questions to the server that brought the page. Its errors are sentences for people.

// The address brings the token in its fragment. It must not stay in the address bar and the
// history, and no cookie may hold it: cookies go to every port of this machine.
function takeToken() {
  const given = new URLSearchParams(location.hash.slice(1)).get("token");
  if (given === null) return false;
  sessionStorage.setItem("token", given);
  history.replaceState(null, "", "/");
  return true;
}
takeToken();
// Another address of the same page was entered.
addEventListener("hashchange", () => { if (takeToken()) location.reload(); });

export const token = () => sessionStorage.getItem("token") ?? "";

const send = (path, options = {}, headers = {}) =>
  fetch(path, { ...options, headers: { ...headers, Authorization: `Bearer ${token()}` } });

export class Refused extends Error {
  constructor(message, status) {
    super(message);
    this.status = status;
  }
}

function unreachable(error) {
  if (error.name === "AbortError") throw error;
  throw new Refused("actioncli does not answer; is it still running?", 0);
}

async function answered(promise) {
  const response = await promise.catch(unreachable);
  if (response.status === 204) return null;
  const text = await response.text();
  let document;
  try {
    document = JSON.parse(text);
  } catch {
    throw new Refused(text.trim() || `actioncli answered ${response.status}.`, response.status);
  }
  if (!response.ok) throw new Refused(document.error.message, response.status);
  return document;
}

export const get = (path) => answered(send(path));

export const ask = (method, path, document = {}) =>
  answered(send(path, { method, body: JSON.stringify(document) }, { "Content-Type": "application/json" }));

// options: of reading, by name.
export const upload = (file, name, options, signal) =>
  answered(send(`/api/clips?${new URLSearchParams({ name, ...options })}`,
    { method: "POST", body: file, signal }, { "Content-Type": "application/octet-stream" }));

// Without waiting: the page may be about to close.
export const forget = (id) => {
  send(`/api/clips/${id}`, { method: "DELETE", keepalive: true }).catch(() => {});
};

// What is at a path, as a file.
export async function file(path) {
  const response = await send(path).catch(unreachable);
  return response.ok ? response.blob() : answered(Promise.resolve(response));
}

// Save it.
export async function download(path, name) {
  const url = URL.createObjectURL(await file(path));
  const link = document.createElement("a");
  link.href = url;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 60_000);
}
