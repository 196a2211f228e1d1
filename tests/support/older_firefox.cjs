// Loaded into Playwright's driver before its own code. Playwright asks each Firefox for what only later ones know (to keep
// the bodies of answers, where downloads go, how a screen is turned), and gives up where one is refused. No test here
// needs any of it of Firefox. Any other refusal stays one.
const { Module } = require("module");

const REFUSED = 'if (object.type === "error") {';
const TAKEN = `if (object.error === "unknown command") {
            callback.resolve({});
          } else ${REFUSED}`;
const compile = Module.prototype._compile;
Module.prototype._compile = function (text, ...rest) {
  return compile.call(this, text.replace(REFUSED, TAKEN), ...rest);
};
