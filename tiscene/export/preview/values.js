// Decoder of buffer_codec.py, and values as text.

const POSITIVE_INFINITY = 2 ** 31 - 1, NEGATIVE_INFINITY = 2 ** 31 - 2, NOT_A_NUMBER = 2 ** 31 - 3;

function bytesOf(base64) {
  const text = atob(base64), bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Return an Int32Array [planes * height * width]; `previous` returns that of the frame before.
async function decodePlanes(text, planes, width, height, previous) {
  const bytes = await inflated(bytesOf(text.slice(1))), size = width * height;
  const before = text[0] === "d" ? await previous() : null;
  const values = new Int32Array(planes * size);
  for (let plane = 0; plane < planes; plane++) {
    const at = plane * size, from = plane * size * 4;
    for (let i = 0; i < size; i++) {
      const zigzag = bytes[from + i] | bytes[from + size + i] << 8 | bytes[from + 2 * size + i] << 16 | bytes[from + 3 * size + i] << 24;
      const residual = (zigzag >>> 1) ^ -(zigzag & 1);
      values[at + i] = (before ? before[at + i] : predicted(values, at, i, width)) + residual | 0;
    }
  }
  return values;
}

// Predict a value from those to the left, above, and in the corner between them.
function predicted(values, at, i, width) {
  const x = i % width, left = x ? values[at + i - 1] : 0, up = i >= width ? values[at + i - width] : 0;
  const corner = x && i >= width ? values[at + i - width - 1] : 0;
  const low = Math.min(left, up), high = Math.max(left, up);
  return corner >= high ? low : corner <= low ? high : left + up - corner;
}

function numberText(value, decimals) {
  if (value === POSITIVE_INFINITY) return "∞";
  if (value === NEGATIVE_INFINITY) return "-∞";
  if (value === NOT_A_NUMBER) return "nan";
  return (value / 10 ** decimals).toFixed(decimals);
}

// Return the value of a buffer at a pixel as text; `names` are those of ids.
function valueText(buffer, planes, pixel, size, names) {
  const numbers = [];
  for (let plane = 0; plane < buffer.planes; plane++) numbers.push(planes[plane * size + pixel]);
  if (buffer.isMask) return numbers[0] ? "True" : "False";
  if (buffer.name.endsWith("coverage")) {
    const scale = 10 ** buffer.decimals, parts = [];
    for (let rank = 0; rank < numbers.length; rank += 2) {
      const id = numbers[rank] / scale;
      if (numbers[rank + 1]) parts.push(`${names(buffer.name, id)} ${numberText(numbers[rank + 1], buffer.decimals)}`);
    }
    return parts.join(", ") || "background";
  }
  if (buffer.unit === "id") return names(buffer.name, numbers[0]);
  const unit = buffer.unit ? ` ${buffer.unit}` : "";
  return numbers.map((value) => numberText(value, buffer.decimals)).join(", ") + unit;
}
