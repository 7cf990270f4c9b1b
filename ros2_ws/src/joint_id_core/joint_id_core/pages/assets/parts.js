"use strict";
// What live pages build their tables and lists of; content is text, never HTML.
(() => {
  const text = (tag, content, look = "") => {
    const element = document.createElement(tag);
    element.textContent = content == null ? "-" : String(content);
    if (look) element.className = look;
    return element;
  };

  // Rows are pairs of cells and a key; a row with a key can be chosen.
  function table(place, head, rows, chosen, select) {
    const all = document.createElement("table");
    const top = all.createTHead().insertRow();
    head.forEach((cell) => top.append(text("th", cell)));
    const body = all.createTBody();
    for (const [cells, key] of rows) {
      const row = body.insertRow();
      cells.forEach((cell) => row.append(cell instanceof Element ? cell : text("td", cell)));
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

  const PARAMETERS = ["parameter", "value", "± (95 %)", "unit", "verdict", "reason"];
  Object.assign(globalThis.jointId, { text, table, list, badge, PARAMETERS });
})();
