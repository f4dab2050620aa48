// The last two minutes of distance, clearance and exposure, drawn on one canvas.

const SPAN_S = 120;
const ROWS = [
  { key: "distance", label: "distance", unit: "m", low: 0, high: 25, colour: "#2c6e9f" },
  { key: "clearance", label: "clearance", unit: "m", low: 0, high: 25, colour: "#1b7a50", floor: 8 },
  { key: "grey", label: "exposure", unit: "", low: 0, high: 255, colour: "#a86400", band: [110, 160] },
];

export class Traces {
  constructor() {
    this.points = [];
  }

  add(seconds, values) {
    this.points.push({ seconds, ...values });
    while (this.points.length && seconds - this.points[0].seconds > SPAN_S) this.points.shift();
  }

  draw(canvas) {
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== width * ratio || canvas.height !== height * ratio) {
      canvas.width = width * ratio;
      canvas.height = height * ratio;
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const row = height / ROWS.length;
    ROWS.forEach((trace, index) => this.drawRow(pen, trace, index * row, width, row));
  }

  drawRow(pen, trace, top, width, height) {
    const left = 78, right = width - 62, bottom = top + height - 5, upper = top + 4;
    const newest = this.points.length ? this.points[this.points.length - 1] : null;
    const y = (value) =>
      bottom - (Math.min(Math.max(value, trace.low), trace.high) - trace.low) /
        (trace.high - trace.low) * (bottom - upper);
    const x = (seconds) => right - (newest.seconds - seconds) / SPAN_S * (right - left);
    pen.fillStyle = "#f4f7f9";
    pen.fillRect(left, upper, right - left, bottom - upper);
    if (trace.band) {
      pen.fillStyle = "#f6ead2";
      pen.fillRect(left, y(trace.band[1]), right - left, y(trace.band[0]) - y(trace.band[1]));
    }
    if (trace.floor) {
      pen.strokeStyle = "#b3261e";
      pen.lineWidth = 1;
      pen.setLineDash([4, 4]);
      pen.beginPath();
      pen.moveTo(left, y(trace.floor));
      pen.lineTo(right, y(trace.floor));
      pen.stroke();
      pen.setLineDash([]);
    }
    pen.font = "13px Arial, sans-serif";
    pen.textBaseline = "middle";
    pen.fillStyle = "#51636f";
    pen.textAlign = "left";
    pen.fillText(trace.label, 0, (upper + bottom) / 2);
    if (newest === null) return;
    pen.strokeStyle = trace.colour;
    pen.lineWidth = 2;
    pen.beginPath();
    let open = false;
    for (const point of this.points) {
      const value = point[trace.key];
      if (value === null) {
        open = false;
        continue;
      }
      if (open) pen.lineTo(x(point.seconds), y(value));
      else pen.moveTo(x(point.seconds), y(value));
      open = true;
    }
    pen.stroke();
    const value = newest[trace.key];
    pen.fillStyle = "#10202b";
    pen.font = "600 17px Arial, sans-serif";
    pen.textAlign = "right";
    const text = value === null ? "–" : value.toFixed(trace.high > 100 ? 0 : 1);
    pen.fillText(text + (value !== null && trace.unit ? " " + trace.unit : ""), width, (upper + bottom) / 2);
  }
}
