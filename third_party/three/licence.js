// Puts the licence of three.js at the head of the bundle: node licence.js TARGET
const fs = require("fs");
const folder = "node_modules/three/";
const { version } = JSON.parse(fs.readFileSync(`${folder}package.json`, "utf8"));
const licence = fs.readFileSync(`${folder}LICENSE`, "utf8").trim();
const head = `/*! three.js ${version}, the parts named in third_party/three/entry.js, bundled and minified by esbuild.\n${licence}\n*/\n`;
fs.writeFileSync(process.argv[2], head + fs.readFileSync("three.min.js", "utf8").trimEnd() + "\n");
