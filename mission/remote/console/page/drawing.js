// Rotor from the front and map, as SVG. Angles as everywhere in bladescout: seen from upwind, from
// straight down counter-clockwise, so towards the viewer's right.

const SIDES = ["PS", "SS", "LE", "TE"];
const LENGTH = 118;
const ROOT = 9;
const LANES = 22; // lanes begin outside the crowd of the three roots

function svg(name, attributes, ...children) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

// Blade A is the one within [-45, 75) degrees of straight down; B and C follow.
export function bladeAngles(stopAngle) {
  const a = stopAngle < 75 ? stopAngle : stopAngle - 120;
  return { A: a, B: a + 120, C: a + 240 };
}

// The share of a blade's length that kept photos of one side span.
export function shareSeen(photos, blade, side, length) {
  const spans = photos
    .filter((p) => p.blade === blade && p.side === side && p.kept)
    .map((p) => [Math.max(0, p.metre - p.half_m), Math.min(length, p.metre + p.half_m)])
    .filter(([from, to]) => to > from)
    .sort((a, b) => a[0] - b[0]);
  let seen = 0, reached = 0;
  for (const [from, to] of spans) {
    seen += Math.max(0, to - Math.max(from, reached));
    reached = Math.max(reached, to);
  }
  return length > 0 ? seen / length : 0;
}

export function drawRotor(picture, progress, photos, bladeLength) {
  const known = progress.stop_angle_deg !== null;
  const parts = [
    svg("path", { d: "M-4.5 8 L-9 152 L9 152 L4.5 8 Z", fill: "#dfe7ec" }),
  ];
  const angles = bladeAngles(known ? progress.stop_angle_deg : 0);
  for (const [name, angle] of Object.entries(angles)) {
    parts.push(drawBlade(name, angle, known, progress, photos, bladeLength));
  }
  parts.push(svg("circle", { r: 9, fill: "#10202b" }), svg("circle", { r: 3, fill: "#fff" }));
  if (known) parts.push(...drawAngle(progress.stop_angle_deg));
  else {
    const text = svg("text", { y: -132, "text-anchor": "middle", "font-size": 13 });
    text.textContent = "stop angle not measured yet";
    parts.push(text);
  }
  picture.replaceChildren(...parts);
}

function drawBlade(name, angle, known, progress, photos, bladeLength) {
  const outline =
    `M-3 0 L-3.5 ${ROOT} L-8 ${ROOT + 22} L-3.2 ${LENGTH} Q0 ${LENGTH + 5} 3.2 ${LENGTH} ` +
    `L8 ${ROOT + 22} L3.5 ${ROOT} L3 0 Z`;
  const blade = svg("g", { transform: `rotate(${-angle})` });
  blade.append(svg("path", {
    d: outline,
    fill: known ? "#f4f7f9" : "#fff",
    stroke: known ? "#8296a3" : "#b6c4cd",
    "stroke-width": 1,
    ...(known ? {} : { "stroke-dasharray": "4 4" }),
  }));
  if (known && bladeLength > 0) {
    SIDES.forEach((side, lane) => {
      const x = (lane - 1.5) * 6.6 + (lane < 2 ? -6 : 6);
      const y = (metre) => LANES + Math.min(Math.max(metre / bladeLength, 0), 1) * (LENGTH - LANES);
      const now = progress.blade === name && progress.side === side;
      blade.append(svg("line", {
        x1: x, x2: x, y1: LANES, y2: LENGTH, stroke: now ? "#10202b" : "#dfe7ec",
        "stroke-width": now ? 6.6 : 4.4, "stroke-linecap": "round",
      }));
      for (const photo of photos) {
        if (photo.blade !== name || photo.side !== side) continue;
        blade.append(svg("line", {
          x1: x, x2: x, y1: y(photo.metre - photo.half_m), y2: y(photo.metre + photo.half_m),
          stroke: photo.kept === false ? "#e0998f" : photo.kept ? "#2c6e9f" : "#8fb6d1",
          "stroke-width": 4.4,
        }));
      }
      if (now && progress.metre !== null) {
        blade.append(svg("circle", {
          cx: x, cy: y(progress.metre), r: 5.5, fill: "#ffd23f", stroke: "#10202b",
          "stroke-width": 1.6,
        }));
      }
    });
  }
  const radians = (angle * Math.PI) / 180, reach = LENGTH + 17;
  const label = svg("text", {
    x: Math.sin(radians) * reach, y: Math.cos(radians) * reach + 6,
    "text-anchor": "middle", "font-size": 17, "font-weight": 700, class: "ink",
  });
  label.textContent = name;
  return svg("g", {}, blade, label);
}

function drawAngle(stopAngle) {
  const radius = 42, radians = (stopAngle * Math.PI) / 180;
  const x = Math.sin(radians) * radius, y = Math.cos(radians) * radius;
  const middle = radians / 2;
  const label = svg("text", {
    x: Math.sin(middle) * (radius + 20), y: Math.cos(middle) * (radius + 20) + 5,
    "text-anchor": "middle", "font-size": 15, "font-weight": 700, class: "amber",
    stroke: "#fff", "stroke-width": 4, "paint-order": "stroke",
  });
  label.textContent = `${stopAngle.toFixed(1)}°`;
  return [
    svg("line", { x1: 0, y1: 0, x2: 0, y2: radius + 8, stroke: "#a86400", "stroke-dasharray": "3 3" }),
    svg("path", {
      d: `M0 ${radius} A${radius} ${radius} 0 0 0 ${x} ${y}`,
      fill: "none", stroke: "#a86400", "stroke-width": 3,
    }),
    label,
  ];
}

// The area of the live picture that was metered; it lies over the picture, and fits it alike.
export function drawMetering(picture, metering) {
  if (!metering) {
    picture.replaceChildren();
    return;
  }
  const [x, y] = metering.centre.map((share) => share * 1000);
  const disc = { cx: x, cy: y, r: metering.radius * 1000 };
  const line = { fill: "#ffd23f", "fill-opacity": 0.22, stroke: "#ffd23f", "stroke-width": 4 };
  picture.setAttribute("viewBox", `0 0 1000 ${metering.aspect * 1000}`);
  if (!metering.outline.length) {
    picture.replaceChildren(svg("circle", { ...disc, ...line }));
    return;
  }
  const clip = svg("clipPath", { id: "near" }, svg("circle", disc));
  const points = metering.outline.map((p) => `${p[0] * 1000},${p[1] * 1000}`).join(" ");
  picture.replaceChildren(clip, svg("polygon", { points, ...line, "clip-path": "url(#near)" }));
}

export function drawMap(picture, state, turbine, rotor, trail) {
  const width = Math.max(picture.clientWidth, 100), height = Math.max(picture.clientHeight, 80);
  picture.setAttribute("viewBox", `0 0 ${width} ${height}`);
  const radius = turbine ? turbine.rotor_diameter_m / 2 : 20;
  const tower = rotor ? rotor.hub_w : turbine ? turbine.tower_enu_m : null;
  const around = [[0, 0]];
  if (tower) around.push([tower[0] - radius, tower[1] - radius], [tower[0] + radius, tower[1] + radius]);
  if (state.position_w) around.push(state.position_w);
  const east = around.map((p) => p[0]), north = around.map((p) => p[1]);
  const spanEast = Math.max(...east) - Math.min(...east) || 20;
  const spanNorth = Math.max(...north) - Math.min(...north) || 20;
  const scale = Math.min((width - 50) / spanEast, (height - 50) / spanNorth);
  const midEast = (Math.max(...east) + Math.min(...east)) / 2;
  const midNorth = (Math.max(...north) + Math.min(...north)) / 2;
  const x = (p) => width / 2 + (p[0] - midEast) * scale;
  const y = (p) => height / 2 - (p[1] - midNorth) * scale;
  const parts = [];
  if (trail.length > 1) {
    parts.push(svg("polyline", {
      points: trail.map((p) => `${x(p).toFixed(1)},${y(p).toFixed(1)}`).join(" "),
      fill: "none", stroke: "#8fb6d1", "stroke-width": 2, "stroke-linejoin": "round",
    }));
  }
  parts.push(svg("path", {
    d: `M${x([0, 0]) - 7} ${y([0, 0])} h14 M${x([0, 0])} ${y([0, 0]) - 7} v14`,
    stroke: "#51636f", "stroke-width": 2,
  }));
  if (tower) parts.push(...drawTurbine(x(tower), y(tower), radius * scale, rotor));
  if (state.position_w) parts.push(drawVehicle(x(state.position_w), y(state.position_w), state));
  parts.push(...drawScale(scale, height));
  picture.replaceChildren(...parts);
}

function drawTurbine(x, y, radius, rotor) {
  const parts = [svg("circle", { cx: x, cy: y, r: 5, fill: "#10202b" })];
  if (rotor) {
    // The rotor lies across its normal, which points downwind.
    const [east, north] = rotor.normal_w, length = Math.hypot(east, north) || 1;
    const dx = (-north / length) * radius, dy = (-east / length) * radius;
    parts.push(svg("line", {
      x1: x - dx, y1: y - dy, x2: x + dx, y2: y + dy,
      stroke: "#10202b", "stroke-width": 4, "stroke-linecap": "round",
    }));
  } else {
    parts.push(svg("circle", {
      cx: x, cy: y, r: radius, fill: "none", stroke: "#8296a3", "stroke-dasharray": "4 4",
    }));
  }
  return parts;
}

function drawVehicle(x, y, state) {
  // ENU yaw: 0 looks east, counter-clockwise; the arrow is drawn looking up.
  const turn = state.yaw_rad === null ? 0 : 90 - (state.yaw_rad * 180) / Math.PI;
  const arrow = svg("path", {
    d: "M0 -13 L9 10 L0 5 L-9 10 Z", fill: "#e2571f", stroke: "#fff", "stroke-width": 1.5,
    transform: `translate(${x} ${y}) rotate(${turn})`,
  });
  const height = svg("text", { x: x + 14, y: y + 5, "font-size": 15, "font-weight": 700, class: "ink", stroke: "#f4f7f9", "stroke-width": 3, "paint-order": "stroke" });
  height.textContent = `${(state.height_m ?? state.position_w[2]).toFixed(0)} m up`;
  return svg("g", {}, arrow, height);
}

function drawScale(scale, height) {
  const metres = [5, 10, 20, 50, 100, 200, 500].find((m) => m * scale > 50) || 1000;
  const text = svg("text", { x: 10, y: height - 14, "font-size": 13 });
  text.textContent = `${metres} m`;
  return [text, svg("line", { x1: 10, x2: 10 + metres * scale, y1: height - 8, y2: height - 8,
    stroke: "#51636f", "stroke-width": 2 })];
}
