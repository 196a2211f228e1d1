// What the page has beside the standard: BokehJS, loaded when the first plot is wanted.

interface Window {
  Bokeh: any
}
