// Keeps the page as the server has it, and tells how far an upload is. Without this script all
// works as well: the page is loaded again by hand.
"use strict";

const EVERY = 1500; // [ms]
const last = new Map();

function parts(page) {
  return new Map([...page.querySelectorAll("[data-live]")].map((part) => [part.id, part]));
}

function replace(id, part) {
  const old = document.getElementById(id);
  const focused = old.contains(document.activeElement) ? document.activeElement : null;
  const open = [...old.querySelectorAll("details")].map((details) => details.open);
  const fresh = document.importNode(part, true);
  [...fresh.querySelectorAll("details")].forEach((details, k) => { details.open = details.open || Boolean(open[k]); });
  old.replaceWith(fresh);
  if (focused) {
    const again = focused.id && document.getElementById(focused.id);
    if (!again) fresh.tabIndex = -1;
    (again || fresh).focus({ preventScroll: true });
  }
  if (fresh.dataset.said) document.getElementById("announced").textContent = fresh.dataset.said;
}

async function look() {
  if (document.hidden) return;
  let answer;
  try {
    answer = await fetch(location.href, { headers: { Accept: "text/html" } });
  } catch {
    document.getElementById("announced").textContent = "The bench does not answer.";
    return;
  }
  if (!answer.ok) return;
  const page = new DOMParser().parseFromString(await answer.text(), "text/html");
  for (const [id, part] of parts(page)) {
    const text = part.outerHTML;
    if (last.get(id) !== undefined && last.get(id) !== text) replace(id, part);
    last.set(id, text);
  }
}

function watch() {
  const live = [...parts(document).values()];
  if (!live.length) return;
  for (const part of live) last.set(part.id, part.outerHTML);
  const every = Math.min(...live.map((part) => Number(part.dataset.live) || EVERY));
  const again = () => look().finally(() => setTimeout(again, every));
  setTimeout(again, every);
}

function take(form) {
  const field = form.querySelector("input[type=file]");
  const target = form.querySelector(".target");
  const stop = (event) => event.preventDefault();
  for (const name of ["dragenter", "dragover"]) {
    form.addEventListener(name, (event) => { stop(event); target.classList.add("over"); });
  }
  form.addEventListener("dragleave", () => target.classList.remove("over"));
  form.addEventListener("drop", (event) => {
    stop(event);
    target.classList.remove("over");
    if (event.dataTransfer.files.length) field.files = event.dataTransfer.files;
  });
  form.addEventListener("submit", (event) => {
    stop(event);
    send(form, field);
  });
}

function send(form, field) {
  const said = form.querySelector(".sent");
  const button = form.querySelector("button[type=submit]");
  const size = [...field.files].reduce((sum, file) => sum + file.size, 0);
  const most = Number(form.dataset.most);
  if (size > most) {
    said.textContent = `More than ${Math.round(most / 1048576)} MB: not sent.`;
    return;
  }
  const request = new XMLHttpRequest();
  request.responseType = "document";
  request.upload.addEventListener("progress", (event) => {
    said.textContent = event.loaded < event.total
      ? `Sent ${Math.round(100 * event.loaded / event.total)} %` : "Unpacking";
  });
  request.addEventListener("load", () => {
    if (request.status < 400) {
      location.assign(request.responseURL);
      return;
    }
    button.disabled = false;
    const why = request.response && request.response.querySelector(".problem");
    said.textContent = why ? why.textContent : `Refused (${request.status}).`;
    said.classList.add("problem");
  });
  request.addEventListener("error", () => {
    button.disabled = false;
    said.textContent = "The bench broke the transfer off, or does not answer.";
  });
  request.open("POST", form.action);
  button.disabled = true;
  said.classList.remove("problem");
  said.textContent = "Sending";
  request.send(new FormData(form));
}

document.querySelectorAll("form.drop").forEach(take);
watch();
