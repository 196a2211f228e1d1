"""Coefficients in plain words."""

import pytest

from gcs.text.meanings import meaning


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("CL_alpha", "lift slope: lift by angle of attack"),
        ("Cm_q", "pitch damping: pitching moment by pitch rate"),
        ("CY_0", "side force at zero angles and rates"),
        ("CD_k", "induced drag: drag by lift squared"),
        ("CD_CL", "drag by lift"),
        ("Cm_alpha_de", "pitching moment by angle of attack times elevator"),
        ("CL_alpha3", "lift by angle of attack cubed"),
        ("gyro_bias_p", ""),
        ("stall.alpha_stall", ""),
    ],
)
def test_a_coefficient_in_words(name: str, words: str) -> None:
    assert meaning(name) == words
