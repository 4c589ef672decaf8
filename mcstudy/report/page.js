"use strict";
// Reads values under the pointer, saves figures, sorts and copies tables. The page is complete without it.
(() => {
  const make = (name, properties, ...children) => {
    const element = Object.assign(document.createElement(name), properties);
    element.append(...children);
    return element;
  };
  const button = (text, title, onclick) => make("button", { type: "button", title, onclick }, text);
  const tip = document.body.appendChild(make("div", { className: "tip", hidden: true }));

  // An axis is [start, end, value at start, value at end, "log" or "linear", label], start and end in the view box.
  const forth = (axis, v) => axis[4] === "log" ? Math.log(v) : v;
  const place = (axis, v) => {
    const [low, high] = [forth(axis, axis[2]), forth(axis, axis[3])];
    return axis[0] + (forth(axis, v) - low) / (high - low) * (axis[1] - axis[0]);
  };
  const valueAt = (axis, at) => {
    const [low, high] = [forth(axis, axis[2]), forth(axis, axis[3])];
    const v = low + (at - axis[0]) / (axis[1] - axis[0]) * (high - low);
    return axis[4] === "log" ? Math.exp(v) : v;
  };
  const short = v => String(Number(v.toPrecision(4))).replaceAll("-", "−");

  function reading(panel, x, y, reach) {
    let best = null, least = reach;
    for (const s of panel.series) s.x.forEach((_, i) => {
      const d = Math.hypot(place(panel.x, s.x[i]) - x, place(panel.y, s.y[i]) - y);
      if (d < least) { least = d; best = { name: s.n, x: s.x[i], y: s.y[i], e: s.e && s.e[i], on: s.on }; }
    });
    const inside = (axis, at) => at >= Math.min(axis[0], axis[1]) && at <= Math.max(axis[0], axis[1]);
    if (!best && inside(panel.x, x) && inside(panel.y, y))
      best = { name: "pointer", x: valueAt(panel.x, x), y: valueAt(panel.y, y), free: true };
    return best;
  }
  function words(panel, r) {
    const line = which => {
      const named = panel.names[which].find(([at]) => Math.abs(at - r[which]) < 0.5);
      const label = panel[which][5] || which;
      return named ? named[1] : `${label}: ${short(r[which])}${r.on === which ? " ± " + short(r.e) : ""}`;
    };
    return [r.name, line("x"), line("y")].filter(Boolean).join("\n");
  }
  function follow(svg, panel) {
    const dot = svg.appendChild(document.createElementNS(svg.namespaceURI, "circle"));
    dot.setAttribute("class", "dot");
    dot.setAttribute("r", "0");
    const show = event => {
      const box = svg.getBoundingClientRect(), scale = svg.viewBox.baseVal.width / box.width;
      const r = reading(panel, (event.clientX - box.left) * scale, (event.clientY - box.top) * scale, 14 * scale);
      tip.hidden = !r;
      dot.setAttribute("r", r && !r.free ? "4" : "0");
      if (!r) return;
      dot.setAttribute("cx", place(panel.x, r.x));
      dot.setAttribute("cy", place(panel.y, r.y));
      tip.textContent = words(panel, r);
      tip.style.left = Math.min(event.clientX + 14, innerWidth - tip.offsetWidth - 8) + "px";
      tip.style.top = Math.max(8, event.clientY - tip.offsetHeight - 10) + "px";
    };
    svg.addEventListener("pointermove", show);
    svg.addEventListener("pointerdown", show);
    svg.addEventListener("pointerleave", () => { tip.hidden = true; dot.setAttribute("r", "0"); });
  }

  const save = (name, blob) => {
    const link = make("a", { download: name, href: URL.createObjectURL(blob) });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  };
  // A text that a spreadsheet would compute gets an apostrophe in front (mcstudy.files.csv_text).
  const plain = cell => /^ *[=+\-@\t\r\n＝＋－＠]/.test(cell) && cell !== "-" && isNaN(cell) ? "'" + cell : cell;
  const quoted = cell => { const c = plain(cell); return /[",\n]/.test(c) ? `"${c.replaceAll('"', '""')}"` : c; };
  const csv = rows => new Blob(["\ufeff" + rows.map(r => r.map(c => quoted(String(c))).join(",")).join("\r\n") + "\r\n"],
    { type: "text/csv" });

  function standalone(figure) {  // all panels as one drawing, with the colours now on screen
    const style = getComputedStyle(document.documentElement), gap = 12;
    const keys = [...figure.querySelectorAll(".legend li")];
    const panels = [...figure.querySelectorAll("svg.plot")], columns = Math.min(3, panels.length);
    const sizes = panels.map(p => p.viewBox.baseVal);
    const w = Math.max(...sizes.map(b => b.width)), h = Math.max(...sizes.map(b => b.height));
    const top = 24 + (keys.length ? 18 : 0);
    const width = columns * (w + gap) + gap, height = top + Math.ceil(panels.length / columns) * (h + gap) + gap;
    const out = document.createElementNS(panels[0].namespaceURI, "svg");
    const add = (name, attributes, text = "") => {
      const e = out.appendChild(document.createElementNS(out.namespaceURI, name));
      for (const [k, v] of Object.entries(attributes)) e.setAttribute(k, v);
      e.textContent = text;
    };
    for (const [k, v] of Object.entries({ viewBox: `0 0 ${width} ${height}`, width, height, "font-family": "sans-serif" }))
      out.setAttribute(k, v);
    add("rect", { width, height, style: "fill:var(--panel)" });
    add("text", { x: gap, y: 18, "font-size": 12, "font-weight": 600, style: "fill:var(--ink)" },
      figure.querySelector("h3").textContent);
    let x = gap;
    for (const key of keys) {
      add("rect", { x, y: 26, width: 9, height: 9, style: `fill:${getComputedStyle(key.firstChild).backgroundColor}` });
      add("text", { x: x + 13, y: 34.5, "font-size": 10, style: "fill:var(--ink)" }, key.textContent);
      x += 30 + 6 * key.textContent.length;
    }
    panels.forEach((panel, i) => {
      const copy = out.appendChild(panel.cloneNode(true));
      copy.querySelectorAll(".dot").forEach(e => e.remove());
      const at = { x: gap + i % columns * (w + gap), y: top + Math.floor(i / columns) * (h + gap),
        width: sizes[i].width, height: sizes[i].height };
      for (const [k, v] of Object.entries(at)) copy.setAttribute(k, v);
    });
    const text = new XMLSerializer().serializeToString(out)
      .replace(/var\(--([a-z]+)\)/g, (_, name) => style.getPropertyValue("--" + name).trim());
    return { text, width, height };
  }
  function png(figure) {
    const { text, width, height } = standalone(figure), image = new Image();
    image.onload = () => {
      const canvas = make("canvas", { width: 3 * width, height: 3 * height });
      canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
      canvas.toBlob(blob => save(figure.id + ".png", blob));
    };
    image.src = "data:image/svg+xml," + encodeURIComponent(text);
  }
  // The panels move into a dialog that fills the window, and back when it closes.
  const box = document.body.appendChild(make("dialog", { className: "lightbox" }));
  let fit = () => {}, back = () => {};
  function enlarge(figure) {
    back();
    const panels = figure.querySelector(".panels"), svgs = [...panels.querySelectorAll("svg.plot")], gap = 12;
    const sizes = svgs.map(s => s.viewBox.baseVal), legend = figure.querySelector(".legend"), place = make("div", {});
    const shown = svgs[0].getBoundingClientRect().width / sizes[0].width, largest = Math.max(...sizes.map(b => b.width));
    const title = figure.querySelector("h3").textContent;
    box.ariaLabel = title;
    box.replaceChildren(make("div", { className: "bar" }, make("strong", {}, title),
      button("Close", "Close (Esc)", () => box.close())), ...(legend ? [legend.cloneNode(true)] : []));
    place.style.height = panels.offsetHeight + "px";
    panels.replaceWith(place);
    box.append(panels, tip);
    fit = () => {  // as large as all panels fit
      const width = box.querySelector(".bar").clientWidth, height = box.clientHeight - panels.offsetTop - gap;
      const needed = scale => {
        let x = 0, y = 0, row = 0;
        for (const b of sizes) {
          if (x && x + gap + b.width * scale > width) { y += row + gap; x = row = 0; }
          x += (x ? gap : 0) + b.width * scale;
          row = Math.max(row, b.height * scale);
        }
        return y + row;
      };
      let scale = (width - 1) / largest;
      while (scale > 1.25 * shown && needed(scale) > height) scale *= 0.98;
      if (scale < 1.25 * shown || needed(scale) > height) {  // larger than on the page, and the window scrolls
        const columns = Math.floor((width + gap) / (1.25 * shown * largest + gap));
        scale = columns ? (width - (columns - 1) * gap - 1) / columns / largest : 1.6 * shown;
      }
      svgs.forEach((s, i) => { s.style.width = sizes[i].width * scale + "px"; });
    };
    back = () => {
      fit = back = () => {};
      svgs.forEach(s => { s.style.width = ""; });
      place.replaceWith(panels);
      tip.hidden = true;
      document.body.append(tip);
    };
    box.showModal();
    fit();
  }
  box.addEventListener("close", () => { if (!box.open) back(); });
  addEventListener("resize", () => fit());
  const drawn = panels => [["panel", "series", "x is", "x", "y is", "y", "error bar on", "error bar"], ...panels.flatMap(
    p => p.series.flatMap(s => s.x.map((x, i) => {
      const named = which => (p.names[which].find(([at]) => at === s[which][i]) || [0, p[which][5]])[1];
      return [p.title, s.n, named("x"), x, named("y"), s.y[i], s.on || "", s.e ? s.e[i] : ""];
    })))];

  for (const figure of document.querySelectorAll("figure")) {
    const data = figure.querySelector("script.readings"), panels = data ? JSON.parse(data.textContent) : [];
    const svgs = figure.querySelectorAll("svg.plot");
    panels.forEach((panel, i) => follow(svgs[i], panel));
    if (!svgs.length) continue;
    const tools = make("div", { className: "tools" },
      Object.assign(button("Enlarge", "This figure over the whole window", () => enlarge(figure)),
        { ariaHasPopup: "dialog" }),
      button("SVG", "Save this figure as SVG", () =>
        save(figure.id + ".svg", new Blob([standalone(figure).text], { type: "image/svg+xml" }))),
      button("PNG", "Save this figure as PNG", () => png(figure)));
    if (panels.some(p => p.series.length))
      tools.append(button("CSV", "Save the plotted numbers", () => save(figure.id + ".csv", csv(drawn(panels)))));
    figure.querySelector("h3").after(tools);
  }

  const number = text => { const m = /-?\d+(\.\d+)?(e[+-]?\d+)?/i.exec(text.replaceAll("−", "-")); return m ? +m[0] : NaN; };
  function sort(table, column, th) {
    const down = th.getAttribute("aria-sort") === "ascending", body = table.tBodies[0];
    const rows = [...body.rows].map(row => [row, row.cells[column].textContent.trim()]);
    const numeric = rows.filter(([, t]) => !isNaN(number(t))).length > rows.length / 2 && column > 0;
    rows.sort(([, a], [, b]) => {
      if (!numeric) return (down ? -1 : 1) * a.localeCompare(b, "en", { numeric: true });
      const [p, q] = [number(a), number(b)];
      return isNaN(p) || isNaN(q) ? isNaN(p) - isNaN(q) : (down ? q - p : p - q);  // what is no number comes last
    });
    for (const other of table.tHead.querySelectorAll("th")) other.removeAttribute("aria-sort");
    th.setAttribute("aria-sort", down ? "descending" : "ascending");
    body.append(...rows.map(([row]) => row));
  }
  async function copy(text) {
    try { await navigator.clipboard.writeText(text); } catch {  // no permission, or an old browser
      const area = document.body.appendChild(make("textarea", { value: text }));
      area.select();
      document.execCommand("copy");
      area.remove();
    }
  }
  for (const table of document.querySelectorAll("table")) {
    if (!table.tHead || !table.caption || !table.tHead.textContent.trim()) continue;
    const title = table.caption.textContent;
    const cells = () => [...table.rows].map(row => [...row.cells].map(c => c.textContent.trim().replaceAll("−", "-")));  // a minus that programs read
    const done = button("Copy", "Copy this table for a spreadsheet", async () => {
      await copy(cells().map(row => row.join("\t")).join("\n"));
      done.textContent = "Copied";
      setTimeout(() => { done.textContent = "Copy"; }, 1500);
    });
    const file = title.replace(/[^\p{L}\p{N}]+/gu, "-").slice(0, 60) + ".csv";
    table.caption.append(make("span", { className: "tools" }, done,
      button("CSV", "Save this table", () => save(file, csv(cells())))));
    if (table.tHead.rows.length === 1) [...table.tHead.rows[0].cells].forEach((th, i) => {
      if (!th.textContent) return;
      const own = button("", "Sort", () => sort(table, i, th));
      own.className = "sort";
      own.append(...th.childNodes);
      th.append(own);
    });
  }

  const links = new Map([...document.querySelectorAll("nav a")].map(a => [a.hash.slice(1), a]));
  const watch = new IntersectionObserver(seen => {
    for (const { target, isIntersecting } of seen) if (isIntersecting) {
      for (const a of links.values()) a.removeAttribute("aria-current");
      const link = links.get(target.id);
      link.setAttribute("aria-current", "true");
      if (matchMedia("(min-width:1200px)").matches) link.scrollIntoView({ block: "nearest" });
    }
  }, { rootMargin: "-10% 0px -80% 0px" });
  for (const id of links.keys()) watch.observe(document.getElementById(id));
})();
