"use strict";
// What live pages build their tables and lists of; content is text, never HTML.
(() => {
  const text = (tag, content, look = "") => {
    const element = document.createElement(tag);
    element.textContent = content == null ? "-" : String(content);
    if (look) element.className = look;
    return element;
  };

  // Rows are pairs of cells and a key; a row with a key can be chosen. `below`: as `document.table`.
  function table(place, head, rows, below, chosen, select) {
    const all = document.createElement("table");
    const first = head.length - below.length;
    const look = (k) => below[k - first] || "";
    all.style.setProperty("--columns", first);
    const top = all.createTHead().insertRow();
    head.forEach((cell, k) => top.append(text("th", cell, look(k))));
    const body = all.createTBody();
    for (const [cells, key] of rows) {
      const row = body.insertRow();
      cells.forEach((cell, k) => row.append(cell instanceof Element ? cell : text("td", cell, look(k))));
      if (key) {
        row.tabIndex = 0;
        row.className = key === chosen ? "chosen" : "choice";
        row.onclick = () => select(key);
        row.onkeydown = (event) => { if (event.key === "Enter") select(key); };
      }
    }
    place.replaceChildren(all);
  }

  function list(place, texts, none) {
    place.replaceChildren(...(texts.length ? texts : [none]).map((t) => text("li", t)));
  }

  function badge(word, look) {
    const cell = document.createElement("td");
    cell.append(text("span", word, `status ${look}`));
    return cell;
  }

  // Says in the head whether what stands on the page is of now; marks of joints are grey if it is not.
  function link(word) {
    const mark = document.getElementById("link");
    mark.textContent = word;
    mark.className = word === "live" ? "status good" : "status";
    document.body.classList.toggle("old", word !== "live");
  }

  function lost() {
    link("not connected");
    document.getElementById("told").textContent = "The node of this page does not answer: what stands here is from before.";
  }

  // Shows every state that the server sends; it sends one a second or more.
  function follow(show) {
    let heard = Date.now();
    const events = new EventSource("events");
    events.onmessage = (event) => {
      heard = Date.now();
      show(JSON.parse(event.data));
    };
    events.onerror = lost;
    setInterval(() => { if (Date.now() - heard > SILENT_MS) lost(); }, 1000);
  }

  const SILENT_MS = 5000;
  const parameters = (place, rows) => table(
    place, ["parameter", "value", "± (95 %)", "unit", "verdict", "reason"], rows.map((row) => [row]), ["word", "text"]);
  Object.assign(globalThis.jointId, { text, table, list, badge, link, lost, follow, parameters });
})();
