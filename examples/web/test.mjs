// Compares the page in a browser, and its code in node, with a native run: node test.mjs NATIVE [--shots DIR]

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { createReadStream, existsSync, mkdirSync, readdirSync, readFileSync } from "node:fs";
import { createServer } from "node:http";
import { createRequire } from "node:module";
import { extname, join } from "node:path";
import { brotliCompressSync, gzipSync } from "node:zlib";

const [native, , shots] = process.argv.slice(2);
const { chromium } = createRequire(import.meta.url)(join(process.env.NODE_MODULES, "playwright-core"));
// Scenes with their size and frames, and the allowed difference (m) due to rounding: one side fuses multiply-adds, and a GPU adds in
// another order. A small cape does not crumple, so two seconds of it stay close. The flag becomes chaotic soon, and the curtain as
// soon as the ball hits it, after a second; the GPU leaves out the curtain, because a software adapter is slow.
const BOUNDS = [["flag", 17, 15, 1e-4], ["cape", 17, 15, 1e-4], ["cape", 9, 120, 1e-4], ["curtain", 17, 120, 5e-2]];

const rms = (a, b) => {
  assert.equal(a.length, b.length);
  return Math.sqrt(a.reduce((sum, x, k) => sum + (x - b[k]) ** 2, 0) / (a.length / 3));
};

const types = { ".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".wasm": "application/wasm" };
const server = createServer((request, response) => {
  const file = join("dist", new URL(request.url, "http://page").pathname.replace(/\/$/, "/index.html"));
  if (!existsSync(file)) return response.writeHead(404).end();
  response.writeHead(200, { "content-type": types[extname(file)] ?? "text/plain" });
  createReadStream(file).pipe(response);
});
await new Promise((ready) => server.listen(0, "127.0.0.1", ready));
const address = `http://127.0.0.1:${server.address().port}/`;

const { initSync, Toy } = await import(new URL("dist/cloth.js", import.meta.url));
const module = readFileSync(new URL("dist/cloth_bg.wasm", import.meta.url));
const size = { gzip: gzipSync(module, { level: 9 }).length, brotli: brotliCompressSync(module).length };
console.log(`module: ${Math.round(size.gzip / 1000)} kB with gzip, ${Math.round(size.brotli / 1000)} kB with brotli`);
assert.ok(size.brotli <= 400_000, "the page's code takes more than 400 kB as a server sends it");
initSync({ module });

const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM,
  args: ["--no-sandbox", "--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader", "--enable-unsafe-swiftshader"],
});
let failed = false;
const errors = [];
try {
  const page = await browser.newPage({ viewport: { width: 1280, height: 800 } });
  page.on("console", (message) => message.type() === "error" && errors.push(message.text()));
  page.on("pageerror", (error) => errors.push(error.message));
  await page.goto(address);
  await page.waitForFunction(() => document.getElementById("stretch").textContent !== "", null, { timeout: 30000 });
  const first = await page.waitForFunction(() => performance.getEntriesByName("first picture")[0]?.startTime);
  console.log(`first picture ${Math.round(await first.jsonValue())} ms after the navigation`);

  for (const file of readdirSync(process.env.SHADERS)) {
    const complaints = await page.evaluate(async (code) => {
      const device = await (await navigator.gpu.requestAdapter()).requestDevice();
      device.pushErrorScope("validation");
      const { messages } = await device.createShaderModule({ code }).getCompilationInfo();
      await device.popErrorScope();
      return messages.filter(({ type }) => type === "error").map(({ lineNum, message }) => `${lineNum}: ${message}`);
    }, readFileSync(join(process.env.SHADERS, file), "utf8"));
    assert.deepEqual(complaints, [], `the browser refuses ${file}`);
  }

  for (const [scene, size, frames, bound] of BOUNDS) {
    const truth = JSON.parse(execFileSync(native, [scene, String(size), String(frames)], { maxBuffer: 1 << 26 }));
    const toy = new Toy(scene, size, undefined);
    const moved = rms(truth, Array.from(toy.positions()));
    toy.set("small steps", 20, true);
    for (let k = 0; k < frames; k++) toy.step();
    const inBrowser = (gpu) => page.evaluate((run) => window.play(...run), [scene, size, frames, gpu]);
    const adapter = await page.evaluate(() => navigator.gpu?.requestAdapter().then((found) => found !== null));
    assert.ok(adapter, "Chromium has no WebGPU adapter");
    const played = { node: () => Array.from(toy.positions()), browser: () => inBrowser(false) };
    if (scene !== "curtain") played.WebGPU = () => inBrowser(true);
    for (const [where, positions] of Object.entries(played)) {
      const start = performance.now();
      const off = rms(await positions(), truth);
      const seconds = ((performance.now() - start) / 1000).toFixed(1);
      console.log(`${scene} ${size}, ${frames} frames in ${where}: ${(1000 * off).toFixed(4)} mm off after ${moved.toFixed(2)} m, ${seconds} s`);
      assert.ok(off < bound && moved > 4 * bound, `${scene} in ${where}: ${off} m off`);
    }
  }

  // The cloth is grabbed in the middle, dragged aside, and released.
  await page.check("input[value=towel]");
  await page.waitForTimeout(300);
  for (const scene of ["towel", "flag", "cape", "curtain"]) {
    await page.check(`input[value=${scene}]`);
    await page.waitForTimeout(2500);
    if (shots) {
      mkdirSync(shots, { recursive: true });
      await page.screenshot({ path: join(shots, `${scene}.png`) });
    }
  }
  const middle = [620, 260];
  await page.mouse.move(...middle);
  await page.mouse.down();
  assert.ok(await page.evaluate(() => document.getElementById("view").classList.contains("held")), "the curtain was not taken hold of");
  await page.mouse.move(middle[0] - 150, middle[1] + 60, { steps: 10 });
  await page.waitForTimeout(500);
  if (shots) {
    await page.screenshot({ path: join(shots, "held.png") });
    await page.emulateMedia({ colorScheme: "dark" });
    await page.screenshot({ path: join(shots, "dark.png") });
  }
  await page.mouse.up();

  // On the GPU, too, the cloth goes on after settings have changed and it was taken hold of.
  await page.selectOption("#size", "17");
  await page.check("#gpu");
  await page.waitForFunction(() => document.getElementById("word").textContent.includes("WebGPU"));
  const moves = async (after) => {
    const said = await page.textContent("#energy");
    await page.waitForFunction((said) => document.getElementById("energy").textContent !== said, said, { timeout: 60000 }).catch(() => {
      throw new Error(`on the GPU the cloth stands still after ${after}`);
    });
  };
  await moves("it was built");
  for (const wind of ["6", "3", "5"]) await page.fill("#wind", wind);
  await moves("the wind has changed");
  await page.mouse.move(...middle);
  await page.mouse.down();
  assert.ok(await page.evaluate(() => document.getElementById("view").classList.contains("held")), "on the GPU the cloth was not taken hold of");
  await moves("it was taken hold of");
  await page.mouse.up();
  await moves("it was released");
  await page.uncheck("#gpu");
  await page.waitForFunction(() => document.getElementById("word").textContent.includes("Drag"));

  await page.selectOption("#method", "relaxation");
  await page.fill("#substeps", "3");
  await page.waitForTimeout(1200);
  await page.keyboard.press("Tab");
  if (shots) {
    const phone = await browser.newPage({ viewport: { width: 390, height: 800 }, colorScheme: "dark" });
    await phone.goto(address);
    await phone.waitForTimeout(2500);
    await phone.screenshot({ path: join(shots, "phone.png") });
  }
  assert.deepEqual(errors, [], "the console has errors");
  console.log("the page loads, plays, is taken hold of, and has nothing to complain of");
} catch (error) {
  console.error([error.message, ...errors].join("\n"));
  failed = true;
} finally {
  await browser.close();
  server.close();
}
process.exit(failed ? 1 : 0);
