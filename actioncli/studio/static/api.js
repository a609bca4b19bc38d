// Questions to the server that brought the page. Its errors are sentences for people.

export class Refused extends Error {
  constructor(message, status) {
    super(message);
    this.status = status;
  }
}

async function answered(promise) {
  let response;
  try {
    response = await promise;
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Refused("actioncli does not answer; is it still running?", 0);
  }
  if (response.status === 204) return null;
  const text = await response.text();
  let told;
  try {
    told = JSON.parse(text);
  } catch {
    throw new Refused(text.trim() || `actioncli answered ${response.status}.`, response.status);
  }
  if (!response.ok) throw new Refused(told.error.message, response.status);
  return told;
}

export const get = (path) => answered(fetch(path));

export const ask = (method, path, document = {}) =>
  answered(fetch(path, {
    method, headers: { "Content-Type": "application/json" }, body: JSON.stringify(document),
  }));

// options: of reading, by name.
export const upload = (file, name, options, signal) =>
  answered(fetch(`/api/clips?${new URLSearchParams({ name, ...options })}`, {
    method: "POST", headers: { "Content-Type": "application/octet-stream" }, body: file, signal,
  }));

// Without waiting: the page may be about to close.
export const forget = (id) => {
  fetch(`/api/clips/${id}`, { method: "DELETE", keepalive: true }).catch(() => {});
};
