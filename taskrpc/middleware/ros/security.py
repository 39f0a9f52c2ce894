"""What is wrong with the settings of ROS's security (SROS 2) if ROS does not start. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping

_NO_SECURITY = "doesn't have the security libraries"
"""What Fast DDS says if it was built without security."""


def is_on(environ: Mapping[str, str]) -> bool:
    """Whether the environment variables switch security on."""
    return environ.get("ROS_SECURITY_ENABLE", "").lower() == "true"


def security_problem(
    environ: Mapping[str, str], error: str, is_folder: Callable[[str], bool]
) -> str:
    """Return the mistake that explains an error of ROS, "" if there is none.

    `environ` has the environment variables.
    """
    if not is_on(environ):
        return ""
    if _NO_SECURITY in error:
        return (
            "ROS_SECURITY_ENABLE is true, but this Fast DDS was built without security, as that of"
            " PyPI is; use ROS 2 from apt, or set ROS_SECURITY_ENABLE=false"
        )
    keystore = environ.get("ROS_SECURITY_KEYSTORE", "")
    if not keystore:
        return (
            "ROS_SECURITY_ENABLE is true, so ROS_SECURITY_KEYSTORE must name a keystore, but it is"
            " not set; set it, or set ROS_SECURITY_ENABLE=false"
        )
    enclave = "/" + environ.get("ROS_SECURITY_ENCLAVE_OVERRIDE", "").strip("/")
    folder = f"{keystore.rstrip('/')}/enclaves{enclave}".rstrip("/")
    if not is_folder(folder):
        return (
            f"expected the keys of the enclave {enclave} in {folder}, but there is no such folder;"
            f" create it: ros2 security create_enclave {keystore} {enclave}"
        )
    return ""
