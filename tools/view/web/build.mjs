// Bundles src/ into one HTML file with its script and style inside, and compresses it.
// build.mjs SOURCES OUTPUT: packages are in OUTPUT/node_modules; writes page.html, page.html.gz, page-licences.txt.
import { createHash } from 'node:crypto';
import { readFileSync, writeFileSync, existsSync } from 'node:fs';
import { createRequire } from 'node:module';
import { dirname, join, resolve } from 'node:path';
import { gzipSync, constants } from 'node:zlib';

const [sources, output] = process.argv.slice(2).map((path) => resolve(path));
const require = createRequire(join(output, 'package.json'));
const esbuild = require('esbuild');
const packages = ['three', 'uplot'];

const common = {
  bundle: true, minify: true, charset: 'utf8', write: false, legalComments: 'none', logLevel: 'warning',
  nodePaths: [join(output, 'node_modules')], absWorkingDir: output, metafile: true,
};
const script = await esbuild.build({ ...common, entryPoints: [join(sources, 'main.js')], format: 'iife', target: 'es2020' });
const style = await esbuild.build({ ...common, entryPoints: [join(sources, 'style.css')] });

// Nothing of the script may end its element.
const js = script.outputFiles[0].text.replaceAll('</script', '<\\/script');
const css = style.outputFiles[0].text;
const hash = (text) => `'sha256-${createHash('sha256').update(text).digest('base64')}'`;
const policy = [
  "default-src 'none'", `script-src ${hash(js)}`, `style-src ${hash(css)}`, "img-src data: blob:",
  "connect-src 'self'", "base-uri 'none'", "form-action 'none'",
].join('; ');

const used = new Set();
for (const result of [script, style])
  for (const path of Object.keys(result.metafile.inputs))
    for (const name of packages) if (path.includes(`node_modules/${name}/`)) used.add(name);
let licences = '';
for (const name of [...used].sort()) {
  const folder = join(output, 'node_modules', name);
  const description = JSON.parse(readFileSync(join(folder, 'package.json'), 'utf8'));
  const file = ['LICENSE', 'LICENSE.md', 'license'].map((f) => join(folder, f)).find(existsSync);
  if (!file) throw new Error(`${name}: no licence file`);
  licences += `${name} ${description.version} (${description.license})\n\n${readFileSync(file, 'utf8').trim()}\n\n`;
}

const html = readFileSync(join(sources, 'index.html'), 'utf8')
  .replace('<!--policy-->', () => `<meta http-equiv="Content-Security-Policy" content="${policy}">`)
  .replace('<!--style-->', () => `<style>${css}</style>`)
  .replace('<!--licences-->', () => licences.replaceAll('&', '&amp;').replaceAll('<', '&lt;'))
  .replace('<!--script-->', () => `<script>${js}</script>`);
const compressed = gzipSync(html, { level: constants.Z_BEST_COMPRESSION });
writeFileSync(join(output, 'page.html'), html);
writeFileSync(join(output, 'page-licences.txt'), licences);
writeFileSync(join(output, 'page.html.gz'), compressed);
const limit = 400 * 1024;
console.log(`page: ${html.length} characters, ${compressed.length} bytes compressed`);
if (compressed.length > limit) throw new Error(`the page is larger than ${limit} bytes`);
