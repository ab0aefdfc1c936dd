"""Grids of TAU in every kind of netCDF that there is."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.io import netcdf_file

from sdm_deflect.meshing.formats.tau import Tau
from sdm_deflect.meshing.mesh.mesh import Mesh

CLASSIC = ("cdf1", "cdf2", "single")
IN_HDF5 = ("hdf5", "chunks", "packed")
KINDS = CLASSIC + IN_HDF5
DIMENSION = b"This is a netCDF dimension but not a netCDF variable. %9d"


def written(mesh: Mesh, path: Path, kind: str = "cdf2") -> Path:
    """Write a mesh as a grid of one kind."""
    Tau().write(mesh, path)
    names, arrays, dimensions, attributes = parts(path)
    if kind == "cdf1":
        classic(path, names, arrays, attributes, 1)
    elif kind == "single":
        single = {name: values.astype("f4") if values.dtype.kind == "f" else values for name, values in arrays.items()}
        classic(path, names, single, attributes, 2)
    elif kind in IN_HDF5:
        in_hdf5(path, names, arrays, dimensions, attributes, kind)
    return path


def parts(path: Path) -> tuple[Any, Any, Any, Any]:
    """Names of each variable's dimensions, variables, dimensions and attributes, by scipy."""
    with netcdf_file(path, "r", mmap=False) as file:
        names = {name: variable.dimensions for name, variable in file.variables.items()}
        arrays = {
            name: variable.data.astype(variable.data.dtype.newbyteorder("="))
            for name, variable in file.variables.items()
        }
        return names, arrays, dict(file.dimensions), dict(file._attributes)


def classic(path: Path, names: Any, arrays: Any, attributes: Any, version: int, growing: str = "") -> None:
    """Write variables with scipy; the dimension `growing` is unlimited."""
    with netcdf_file(path, "w", version=version) as file:
        for name, value in {"comment": np.array([1.5, 2.5]), **attributes}.items():
            setattr(file, name, value)
        if growing:
            file.createDimension(growing, None)
        for name, values in arrays.items():
            for dimension, length in zip(names[name], values.shape, strict=True):
                if dimension not in file.dimensions:
                    file.createDimension(dimension, length)
            made = file.createVariable(name, values.dtype.char.replace("S", "c"), names[name])
            made[... if not values.ndim else slice(None)] = values
            made.units = "m"


def in_hdf5(path: Path, names: Any, arrays: Any, dimensions: Any, attributes: Any, kind: str) -> None:
    """Write variables and dimensions as the netCDF library does."""
    packing = {"hdf5": {}, "chunks": {"chunks": True}, "packed": {"chunks": True, "compression": "gzip"}}[kind]
    with h5py.File(path, "w", track_order=True) as file:
        for name, length in dimensions.items():
            file.create_dataset(name, shape=(length,), dtype=">f4").make_scale(DIMENSION % length)
        for name, values in arrays.items():
            sizes = packing | ({"chunks": (min(5, len(values)),)} if packing and values.ndim == 1 else {})
            made = file.create_dataset(name, data=values, **sizes)
            for i, dimension in enumerate(names[name]):
                made.dims[i].attach_scale(file[dimension])
        for name, value in attributes.items():
            file.attrs[name] = value if name == "type" else value.decode()
