"""Whether a device is there."""

from __future__ import annotations

from spot_model.errors import BadInputError


def check_device(device: str) -> None:
    """Refuse a device that is not there.

    Raises:
        BadInputError: No such device; the message says what there is.
    """
    if device == "cpu":
        return
    import torch

    if not device.startswith("cuda"):
        raise BadInputError(f"device {device!r} is unknown; allowed: cpu, cuda, cuda:N")
    if not torch.cuda.is_available():
        raise BadInputError(
            f"device {device!r}: there is no usable NVIDIA GPU here (torch {torch.__version__}); "
            "use --device cpu, or a machine with a GPU and a CUDA build of torch"
        )
    index = torch.device(device).index or 0
    if index >= torch.cuda.device_count():
        raise BadInputError(f"device {device!r}: there are {torch.cuda.device_count()} GPUs, cuda:0 upwards")
