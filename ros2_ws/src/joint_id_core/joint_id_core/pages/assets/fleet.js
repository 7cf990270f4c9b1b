"use strict";
// Keeps the page of a fleet up to date: a table of robots and one of joints from events, parameters of the chosen joint.
(() => {
  const $ = (id) => document.getElementById(id);
  const { table, badge, link, lost, follow, parameters } = jointId;
  const LEVELS = ["ok", "warning", "error", "silent"];
  let chosen = decodeURIComponent(location.hash.slice(1));
  let newest = null;

  function select(key) {
    chosen = key;
    history.replaceState(null, "", `#${encodeURIComponent(key)}`);
    show(newest);
    refresh();
  }

  function show(state) {
    if (!state || !state.robots) return;
    newest = state;
    const { robots, joints } = state;
    const count = (look) => joints.filter((j) => j[3] === look).length;
    link("live");
    $("told").textContent = robots.length
      ? `${robots.length} robots (${robots.filter((r) => r[1]).length} gone), ${joints.length} joints: ` +
        `${count("good")} converged, ${count("idle")} at rest or gone, ${count("fair")} in doubt, ${count("")} wrong`
      : "No robot yet: does anything publish joint_params?";
    table($("robots"), ["robot", "state", "joints good", "wrong", "estimate [s] ago", "payload", "what its nodes say"],
      robots.map(([name, gone, all, good, wrong, ago, payload, level, says]) => [[
        name, gone ? badge("gone", "idle") : badge(LEVELS[level] || "?", ["good", "fair"][level] || ""),
        `${good} of ${all}`, wrong, ago, payload, says,
      ]]), ["text", "text"]);
    const wanted = $("wanted").value.trim().toLowerCase();
    const shown = joints.filter((j) => !wanted || j.slice(0, 3).join(" ").toLowerCase().includes(wanted));
    table($("joints"), ["robot", "joint", "status", "estimated", "age [s]", "since [s]", "model", "changes and alarms"],
      shown.map(([robot, joint, status, look, model, age, since, alarms, found]) => [[
        robot, joint, badge(status, look), found, age, since, model, alarms,
      ], `${robot} ${joint}`]), ["more", "more", "more", "word", "text"], chosen, select);
    document.body.dataset.states = String(Number(document.body.dataset.states || 0) + 1);
    refresh();
  }

  async function refresh() {
    if (!chosen) return;
    const at = chosen.indexOf(" ");  // a namespace has none
    const [robot, joint] = [chosen.slice(0, at), chosen.slice(at + 1)];
    try {
      const query = `robot=${encodeURIComponent(robot)}&joint=${encodeURIComponent(joint)}`;
      const answer = await fetch(`joint?${query}`);
      if (!answer.ok) { $("says").textContent = await answer.text(); return; }
      const found = await answer.json();
      $("says").textContent = [`${robot}, ${joint}: ${found.message}`, ...found.alarms].join("; ");
      parameters($("parameters"), found.parameters);
    } catch (error) {
      lost();
    }
  }

  $("wanted").oninput = () => show(newest);
  follow(show);
})();
