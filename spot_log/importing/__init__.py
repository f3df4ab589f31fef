"""Import of foreign recordings; a mapping file says which array is which signal."""

from spot_log.importing.importer import import_log
from spot_log.importing.mapping import Mapping, load_mapping

__all__ = ["Mapping", "import_log", "load_mapping"]
