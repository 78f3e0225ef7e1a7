"""The style sheet of a report: for phones, for large screens and for print."""

STYLE = """
:root{color-scheme:light;--ink:#1a1c20;--soft:#4a4f57;--line:#cfd3d8;--paper:#fff;--wash:#f3f6f9;--accent:#00538a}
*{box-sizing:border-box}
html{-webkit-text-size-adjust:100%;scroll-behavior:smooth}
body{margin:0;background:var(--paper);color:var(--ink);font:17px/1.5 system-ui,
-apple-system,"Segoe UI",Roboto,"DejaVu Sans",sans-serif;overflow-wrap:anywhere}
header,main,footer{max-width:1200px;margin:0 auto;padding:0 16px}
header{padding-top:28px}
.kicker{margin:0;color:var(--soft);letter-spacing:.04em;text-transform:uppercase;font-size:.8rem}
h1{font-size:clamp(1.6rem,5vw,2.4rem);line-height:1.15;margin:.2em 0 .6em}
h2{font-size:1.35rem;line-height:1.25;margin:2.2em 0 .5em;padding-top:.5em;border-top:2px solid var(--line)}
h3{font-size:1.05rem;margin:1.6em 0 .3em}
p,dd,li{max-width:46em}
a{color:var(--accent)}
a:focus-visible,pre:focus-visible{outline:3px solid var(--accent);outline-offset:2px}
.skip{position:absolute;left:-999em}
.skip:focus{left:8px;top:8px;background:#fff;padding:8px}
.short{background:var(--wash);border-left:6px solid var(--accent);padding:4px 18px 14px}
.lead{font-size:1.2rem;line-height:1.4;margin:0 0 1em;max-width:44em}
.beside{display:grid;gap:8px 28px;grid-template-columns:minmax(0,1fr)}
.two{columns:24em;column-gap:28px}
.two>div{break-inside:avoid}
@media (min-width:1000px){.beside{grid-template-columns:minmax(0,3fr) minmax(0,2fr)}.beside .plots{grid-template-columns:1fr}}
.short h2{border:0;margin-top:.4em;padding:0}
dl{margin:0}
dl>div{margin:0 0 .8em}
dt{font-weight:700}
dd{margin:0}
nav ul{columns:18em;margin:0;padding-left:1.2em}
nav h2{font-size:1.05rem;border:0;margin:1.4em 0 .3em}
.plots{display:grid;gap:18px;grid-template-columns:repeat(auto-fit,minmax(min(100%,330px),1fr));margin:1em 0}
figure{margin:0;max-width:520px;background:#fff;padding-bottom:4px}
figure svg *{stroke-linejoin:round}
figure svg{display:block;width:100%;height:auto}
figcaption{font-size:.78rem;color:var(--soft)}
ul{padding-left:1.3em}
.moments{padding-left:1.3em}
.moments img{display:block;max-width:100%;height:auto;margin:.5em 0;border:1px solid var(--line)}
.note{color:var(--soft);font-style:italic}
table{border-collapse:collapse;width:100%;font-size:.86rem;margin:.6em 0 1.6em;font-variant-numeric:tabular-nums;overflow-wrap:normal}
caption{text-align:left;color:var(--soft);padding:.2em 0}
th,td{text-align:left;vertical-align:top;padding:.3em .6em .3em 0;border-bottom:1px solid var(--line)}
td{overflow-wrap:anywhere}
pre{background:var(--wash);padding:12px;white-space:pre-wrap;overflow-wrap:anywhere;font-size:.85rem}
footer{color:var(--soft);font-size:.85rem;padding-top:2em;padding-bottom:3em}
@media (max-width:900px){
table,caption,tbody,tr,th,td{display:block}
thead{position:absolute;left:-999em}
tr{border-bottom:2px solid var(--line);padding:.5em 0}
th,td{border:0;padding:.1em 0}
td{display:grid;grid-template-columns:8em 1fr;gap:.6em}
td::before{content:attr(data-label);color:var(--soft)}
}
@media print{
body{font-size:10.5pt}
header,main,footer{max-width:none;padding:0}
nav,.skip{display:none}
.short{border-left:3pt solid #000;background:none}
figure,tr,.moments li{break-inside:avoid}
h2,h3{break-after:avoid}
a{color:inherit;text-decoration:none}
.plots{grid-template-columns:repeat(2,1fr)}
}
""".strip()
