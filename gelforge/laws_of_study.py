"""The constitutive models of a study's materials: given, read from files, or fitted by the study before.

What reads and fits them is imported when a function is called, so that commands which need none start at once.
"""

from __future__ import annotations

from pathlib import Path

from gelforge.config import ConfigError, Study


def law_path(study: Study, material: str) -> Path:
    """Return where a study keeps the constitutive model that it has fitted to a material.

    Parameters
    ----------
    study : Study
        The study.
    material : str
        A key of `study.materials`.

    Returns
    -------
    Path
        results/<study>/materials/<material>/law.json, whether it exists or not.
    """
    return study.results_folder / "materials" / material / "law.json"


def laws_of(study: Study, files: list[Path]) -> dict:
    """Return the constitutive models of a study.

    Parameters
    ----------
    study : Study
        Its materials name tests or parameters.
    files : list of Path
        Law files that replace the study's own, by the material that each states.

    Returns
    -------
    dict of str to PrincipalLaw
        By material, moduli in MPa.

    Raises
    ------
    ConfigError
        For a material with tests but no fitted model, and for a stiffness that is neither plausible nor confirmed.
    """
    return {name: material.law for name, material in material_laws_of(study, files).items()}


def material_laws_of(study: Study, files: list[Path]) -> dict:
    """Return the constitutive models of a study with what is known of them.

    Parameters
    ----------
    study : Study
        Its materials name tests or parameters.
    files : list of Path
        Law files that replace the study's own, by the material that each states.

    Returns
    -------
    dict of str to MaterialLaw
        By material: model [MPa], covariance and tested range, where they are known.

    Raises
    ------
    ConfigError
        For a material with tests but no fitted model, and for a stiffness that is neither plausible nor confirmed.
    """
    laws = known_laws(study, files)
    for name in study.materials:
        if name not in laws:
            raise ConfigError(
                f"material {name} has tests but no constitutive model yet; run `snakemake {law_path(study, name)}`"
                " or give --laws"
            )
    return laws


def known_laws(study: Study, files: list[Path]) -> dict:
    """Return the constitutive models that a study has so far: materials that have tests but no fitted model are left out.

    Parameters
    ----------
    study : Study
        Its materials name tests or parameters.
    files : list of Path
        Law files that replace the study's own, by the material that each states.

    Returns
    -------
    dict of str to MaterialLaw
        By material: model [MPa], covariance and tested range, where they are known.

    Raises
    ------
    ConfigError
        For a stiffness that is neither plausible nor confirmed.
    """
    from gelforge.materials.characterise import known_law
    from gelforge.materials.fitting.law_file import read_law
    from gelforge.materials.fitting.stiffness import check_stiffness

    laws = {law.material: law for law in map(read_law, files)}
    for name, material in study.materials.items():
        if name not in laws and material.tests is None:
            laws[name] = known_law(name, material)
        elif name not in laws and law_path(study, name).is_file():
            laws[name] = read_law(law_path(study, name))
        if name in laws:
            check_stiffness(laws[name], material.stiffness_confirmed)
    return laws


def laws_and_doubts(read: dict) -> tuple[dict, dict]:
    """Return constitutive models, and the same models moved along the directions in which their parameters are uncertain.

    Parameters
    ----------
    read : dict of str to MaterialLaw
        By material, as `material_laws_of` returns them.

    Returns
    -------
    dict of str to PrincipalLaw
        By material [MPa].
    dict of str to list of PrincipalLaw
        Of materials with a covariance: one model per independent direction, moved by AMOUNT standard deviations.
    """
    from gelforge.indentation.solving.error_bars import AMOUNT
    from gelforge.materials.fitting.law_file import moved_laws

    laws = {name: material.law for name, material in read.items()}
    known = {name: material for name, material in read.items() if material.covariance is not None}
    return laws, {name: moved_laws(material, AMOUNT) for name, material in known.items()}
