"""URDF and xacro as a source: XML with lines, links, joints, what a CAD export leaves."""
