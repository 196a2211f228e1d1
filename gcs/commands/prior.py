"""`gcs prior`: a model before any flight, from another program's derivatives or from the aircraft's sizes."""

import argparse
import sys

NAME = "prior"
HELP = "make a prior model for identify --prior, of AVL, XFLR5, AeroSandbox or the aircraft's sizes"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from gcs.options.outputs import MODEL, add_output
    from gcs.priors.prior import SOURCES
    from gcs.priors.signs import POSITIVE

    add = parser.add_argument
    add("file", metavar="FILE", help="the program's file; with --from geometry a vehicle file, or a built-in vehicle")
    add("--from", choices=SOURCES, required=True, dest="source",
        help="avl: what ST writes; xflr5: the log of a stability analysis; aerosandbox: run_with_stability_derivatives"
        " as JSON; geometry: [geometry] of a vehicle file, by handbook formulas")  # fmt: skip
    add("--doubt", metavar="SHARE", type=float,
        help="share of every value that is in doubt, 1 sigma, as 0.3 (default: by kind, 10 to 75 %%)")  # fmt: skip
    signs = "; ".join(f"{control}: {words}" for control, words in POSITIVE.items())
    add("--reverse", metavar="CONTROL", choices=tuple(POSITIVE), action="append", default=[],
        help="a control that your vehicle file counts the other way (repeatable). Positive in FILE must be, and in the"
        f" prior is without this: {signs}")  # fmt: skip
    add_output(parser, "-o", "--output", kind=MODEL, metavar="PRIOR.json", required=True, help="for identify --prior")


def run(args: argparse.Namespace) -> int:
    """Write the model, print it, and say what was left out."""
    from gcs.priors.prior import prior_model, prior_text
    from gcs.text.files import write_whole
    from gcs.text.jsontext import dumps

    model, remarks = prior_model(args.file, args.source, args.doubt, args.reverse)
    write_whole(args.output, dumps(model.to_json(), indent=2))
    print(prior_text(model))
    if not args.quiet:
        for one in remarks:
            print(one, file=sys.stderr)
    return 0
