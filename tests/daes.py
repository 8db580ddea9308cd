"""A COLLADA file with two cubes, for tests to change."""

DAE = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
 <asset><created>{date}</created><modified>{date}</modified>
  <unit name="x" meter="{unit}"/><up_axis>{up}</up_axis></asset>
 <library_cameras><camera id="cam"><optics><technique_common><perspective>
  <yfov>1</yfov><znear>0.1</znear><zfar>9</zfar></perspective></technique_common></optics></camera>
 </library_cameras>
 <library_effects>
  <effect id="e1"><profile_COMMON><technique sid="c"><lambert><diffuse>
   <color>0.1 0.2 0.3 1</color></diffuse></lambert></technique></profile_COMMON></effect>
  <effect id="e2"><profile_COMMON><technique sid="c"><lambert><diffuse>
   <color>0.9 0.8 0.7 0.5</color></diffuse></lambert></technique></profile_COMMON></effect>
 </library_effects>
 <library_materials>
  <material id="m1" name="材质"><instance_effect url="#e1"/></material>
  <material id="m2" name="red"><instance_effect url="#e2"/></material>
 </library_materials>
 <library_geometries><geometry id="g"><mesh>
  <source id="pos"><float_array id="pa" count="24">{positions}</float_array>
   <technique_common><accessor source="#pa" count="8" stride="3">
   <param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
   </accessor></technique_common></source>
  <vertices id="v"><input semantic="POSITION" source="#pos"/></vertices>
  <triangles material="s1" count="4"><input semantic="VERTEX" source="#v" offset="0"/>
   <p>0 1 3 0 3 2 4 6 7 4 7 5</p></triangles>
  <polylist material="s2" count="2"><input semantic="VERTEX" source="#v" offset="0"/>
   <vcount>4 4</vcount><p>0 4 5 1 2 3 7 6</p></polylist>
  <polygons material="s2" count="2"><input semantic="VERTEX" source="#v" offset="0"/>
   <p>0 2 6 4</p><p>1 5 7 3</p></polygons>
  <lines material="s1" count="1"><input semantic="VERTEX" source="#v" offset="0"/>
   <p>0 7</p></lines>
 </mesh></geometry></library_geometries>
 <library_visual_scenes><visual_scene id="s">
  <node id="outer"><translate>10 0 0</translate>
   <node id="plain"><instance_geometry url="#g"><bind_material><technique_common>
    <instance_material symbol="s1" target="#m1"/><instance_material symbol="s2" target="#m2"/>
   </technique_common></bind_material></instance_geometry></node>
   <node id="mirror"><matrix>-1 0 0 -3  0 1 0 0  0 0 1 0  0 0 0 1</matrix>
    <instance_geometry url="#g"><bind_material><technique_common>
    <instance_material symbol="s1" target="#m1"/><instance_material symbol="s2" target="#m2"/>
   </technique_common></bind_material></instance_geometry></node>
  </node></visual_scene></library_visual_scenes>
 <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>
"""
CUBE = "0 0 0  0 0 1  0 1 0  0 1 1  1 0 0  1 0 1  1 1 0  1 1 1"


def dae(positions=CUBE, unit="0.01", up="Z_UP", date="2024-01-01T00:00:00") -> bytes:
    text = DAE.format(positions=positions, unit=unit, up=up, date=date)
    return text.encode()
