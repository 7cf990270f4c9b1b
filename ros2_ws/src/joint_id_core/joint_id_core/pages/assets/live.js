"use strict";
// Keeps a live page up to date: a table of the joints from events, plots of the chosen joint when an event comes.
(() => {
  const $ = (id) => document.getElementById(id);
  let chosen = decodeURIComponent(location.hash.slice(1));
  let shown = ""; // the chosen joint, or the first one while there is none of that name
  let busy = false;
  let drawn = "";

  const { text, table, list, badge, link, lost, follow, parameters } = jointId;

  function select(joint) {
    chosen = shown = joint;
    history.replaceState(null, "", `#${encodeURIComponent(joint)}`);
    refresh();
  }

  // What a node says beside the alarms of joints, which are there already.
  const alone = (message, joints) => message.split("; ")
    .filter((part) => !joints.some((j) => j.alarms.length && part.startsWith(`${j.joint}: `))).join("; ");

  function show(state) {
    if (!state.joints) return;
    const joints = state.joints;
    shown = (joints.find((j) => j.joint === chosen) || joints[0] || { joint: "" }).joint;
    link(state.silent.length ? "silent" : "live");
    $("told").textContent = state.silent.length
      ? `${state.silent.join("; ")}${joints.length ? ": what stands here is from before" : ""}.`
      : joints.length ? `${joints.length} joint${joints.length > 1 ? "s" : ""}, ${joints.filter((j) => j.good).length} converged`
      : state.nodes.some((n) => n.name.endsWith("identifier")) ? "No estimate yet: it takes a window of motion."
        : "No estimate yet: no identifier is running.";
    list($("alarms"), joints.flatMap((j) => j.alarms.map((a) => `${j.joint}: ${a}`)).concat(
      state.nodes.filter((n) => n.level > 0).map((n) => [n.name, alone(n.message, joints)])
        .filter(([, message]) => message).map((told) => told.join(": "))), "None.");
    table($("joints"), ["joint", "status", "age [s]", "temp. [°C]", "model", "nrmse"], joints.map((j) => [[
      j.joint, badge(j.status, j.look), j.age, j.temperature, j.model,
      Object.entries(j.nrmse).map(([n, v]) => `${n} ${v == null ? "-" : v}`).join(", "),
    ], j.joint]), ["word", "text"], shown, select);
    const joint = joints.find((j) => j.joint === shown);
    $("report").href = `report?joint=${encodeURIComponent(shown)}`;
    $("choice").hidden = !joint;
    $("choose").hidden = joints.length < 2;
    $("says").textContent = joint ? `${joint.joint}: ${joint.message}` : "";
    if (joint) parameters($("parameters"), joint.parameters);
    else $("parameters").replaceChildren();
    $("payload").textContent = state.payload || "";
    $("payload").parentElement.hidden = !state.payload;
    table($("nodes"), ["node", "state", "what it says", "values"], state.nodes.map((n) => [[
      n.name, badge(["ok", "warning", "error", "silent"][n.level] || "?", ["good", "fair"][n.level] || ""), n.message,
      n.values.map(([k, v]) => `${k}: ${v || "none"}`).join("; "),
    ]]), ["text", "text"]);
    document.body.dataset.states = String(Number(document.body.dataset.states || 0) + 1);
    refresh();
  }

  function place(parent, plots) {
    plots.forEach((plot) => {
      let figure = [...parent.children].find((f) => f.dataset.title === plot.title);
      if (!figure) {
        figure = document.createElement("figure");
        figure.dataset.title = plot.title;
        figure.append(text("figcaption", plot.title));
        parent.append(figure);
      }
      jointId.draw(figure, plot);
    });
  }

  // Removes all plots; those to come are of this kind.
  function forget(kind) {
    jointId.clear();
    $("trends").replaceChildren();
    $("fit").replaceChildren();
    $("window").textContent = "";
    drawn = kind;
  }

  async function refresh() {
    if (busy) return;
    if (!shown) {
      forget("");
      return;
    }
    busy = true;
    const wanted = shown;
    try {
      const answer = await fetch(`joint?name=${encodeURIComponent(wanted)}`);
      const told = await answer.text();
      if (wanted !== shown) return;
      if (!answer.ok) { $("window").textContent = told; return; }
      const found = JSON.parse(told);
      // Another joint, or other curves: a plot is made for its curves.
      const kind = JSON.stringify([wanted, ...found.trends.concat(found.fit).map((p) => [p.title, p.series, p.bands])]);
      if (kind !== drawn) forget(kind);
      place($("trends"), found.trends);
      place($("fit"), found.fit);
      $("window").textContent = found.told;
    } catch (error) {
      lost();
    } finally {
      busy = false;
      if (wanted !== shown) refresh();
    }
  }

  for (const button of document.querySelectorAll("button[data-action]")) {
    button.onclick = async () => {
      const name = button.dataset.action;
      if (name === "reset" && !confirm("Forget all that is known of the joints?")) return;
      button.disabled = true;
      try {
        const answer = await fetch(`action/${name}`, { method: "POST", headers: { "X-Joint-Id": "1" } });
        $("answer").textContent = answer.ok ? (await answer.json()).message : await answer.text();
      } catch (error) {
        lost();
      } finally {
        button.disabled = false;
      }
    };
  }

  follow(show);
})();
