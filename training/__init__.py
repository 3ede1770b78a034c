"""How the shipped models are made: furniture without end, buildings, sensors, networks. Never imported by the product."""
